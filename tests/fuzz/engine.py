"""Runs the fuzzer atheris; arguments: name of a target, then arguments of libFuzzer."""

import sys
from pathlib import Path

import atheris

sys.path.insert(0, str(Path(__file__).parents[1]))
target = sys.argv.pop(1)
with atheris.instrument_imports(include=["spots", "spots_device", "tomllib"]):
    import targets

# To merge inputs, libFuzzer starts this program again with a shell, by the name in argv[0].
sys.argv[0] = f"{sys.executable} {__file__} {target}"
atheris.Setup(sys.argv, lambda data: targets.run(target, data))
atheris.Fuzz()
