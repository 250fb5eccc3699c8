"""How much of a board's memory the firmware takes once it runs."""

from spots.build import build, files_of

HEAP_MAX_BYTES = 64 * 1024


def test_the_running_application_leaves_most_of_a_small_board_free(unix64, tmp_path, calibration):
    """Estimated from 64 bits, for the machine of 32 bits collects nothing while a script runs.

    Code, constants and names are as long on every board, about as the .mpy files hold them; of
    all else no more than half is left where a word is half as long. What stands in for bus, clock
    and port is counted too, and modules compiled on the spot lie in the heap as loaded ones do.
    """
    (taken,) = unix64.run("heap", {"calibration": calibration})
    files = files_of(build("pico", tmp_path))
    code = sum(len(data) for path, data in files.items() if path.endswith(".mpy"))
    estimate = code + (int(taken) - code) // 2
    print(f"heap in 64 bits {taken} bytes, of these code {code}, on a board about {estimate}")
    assert code < estimate <= HEAP_MAX_BYTES
