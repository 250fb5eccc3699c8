"""The program and the configurations in docs/lab/zenoh.md, and the table of its reference."""

from __future__ import annotations

import os
import re
import socket
import subprocess
import sys
from pathlib import Path

import pytest
import trustme
from support.net import (
    DEADLINE_S,
    Announced,
    ask,
    content,
    frames,
    publishing,
    session,
    stand_in,
    tokens,
    topic_key,
    wait_until,
)

import spots
from spots_net import zenoh_session as session_module
from spots_net.ros2.messages import DIAGNOSTICS, types
from spots_net.ros2.naming import node_of
from spots_net.ros2.types import FRAME
from spots_net.zenoh_session import READ_ONLY, open_session

LAB = Path(__file__).parents[2] / "docs" / "lab"
TEXT = (LAB / "zenoh.md").read_text(encoding="utf-8")


def blocks(language):
    return re.findall(rf"```{language}\n(.*?)```", TEXT, re.DOTALL)


@pytest.mark.board
def test_the_subscriber_needs_nothing_of_ours(net):
    (program,) = (block for block in blocks("python") if "import zenoh" in block)
    assert "spots." not in program
    assert len(program.strip().splitlines()) <= 10
    with publishing(net.hub, stand_in()):
        run = subprocess.Popen(
            [sys.executable, "-c", program],
            env=os.environ | {"ZENOH_CONFIG": str(net.leaf)},
            stdout=subprocess.PIPE,
            text=True,
        )
        try:
            assert run.stdout.readline() == "spots_a1_strip0 0.0425\n"
        finally:
            run.kill()
            run.communicate()


def test_every_topic_and_service_is_in_the_table():
    page = (LAB / "zenoh-reference.md").read_text(encoding="utf-8")
    table = page[page.index("| topic or service |") : page.index("has the definitions")]
    for name in ("frames", "/diagnostics", *types(), *READ_ONLY):
        assert f"{name}`" in table
    for kind in (FRAME, DIAGNOSTICS, *types().values()):
        assert f"{kind.rpartition('/')[2]}`" in table


@pytest.fixture
def certified(tmp_path):
    """The Zenoh configurations of the document, adapted to this machine, with test certificates."""
    authority = trustme.CA()
    authority.cert_pem.write_to_path(tmp_path / "ca.pem")
    for name in ("board-host", "reader", "intruder"):
        issued = authority.issue_cert("127.0.0.1", common_name=name)
        issued.private_key_pem.write_to_path(tmp_path / f"{name}.key")
        for part in issued.cert_chain_pems:
            part.write_to_path(tmp_path / f"{name}.pem", append=True)
    with socket.create_server(("127.0.0.1", 0)) as free:
        place = f"127.0.0.1:{free.getsockname()[1]}"
    publisher, reader = (block for block in blocks("json5") if "enable_mtls" in block)
    for name, text in {
        "board-host": publisher,
        "intruder": publisher.replace("board-host", "intruder"),
        "reader": reader,
    }.items():
        text = text.replace("reader.local:7447", place)
        text = re.sub(r'"([\w-]+\.(pem|key))"', rf'"{tmp_path}/\1"', text)
        (tmp_path / f"{name}.json5").write_text(text)
    return tmp_path


def test_only_one_machine_may_publish(certified, monkeypatch):
    monkeypatch.setenv("ZENOH_CONFIG", str(certified / "reader.json5"))
    heard = []
    with open_session() as reader, session(certified / "intruder.json5") as intruder:
        reader.declare_subscriber("0/**", lambda sample: heard.append(bytes(sample.payload)))
        wait_until(lambda: len(reader.info.peers_zid()) == 1)
        with (
            Announced(intruder, "b2") as foreign,
            publishing(certified / "board-host.json5", stand_in()),
        ):
            wait_until(lambda: heard)
            for command in READ_ONLY:
                foreign.replies_cdr(command, b"wrong")
                Announced(intruder, "a1").replies_cdr(command, b"wrong")
            intruder.put(frames("a1").key(0), b"wrong")
            intruder.put(topic_key("b2", "reading"), b"wrong")
            count = len(heard)
            wait_until(lambda: len(heard) > count + 200)
            alive = [node_of(str(one.ok.key_expr)) for one in reader.liveliness().get(tokens())]
            (info,) = map(content, ask(reader, "a1", "hello"))
    assert b"wrong" not in heard
    assert alive == ["spots_a1"]
    assert info["board"] == "stand-in"


def test_a_board_is_read_through_these_configurations(certified, monkeypatch):
    monkeypatch.setenv("ZENOH_CONFIG", str(certified / "reader.json5"))
    monkeypatch.setattr(session_module, "_PATIENCE_S", DEADLINE_S)
    far = publishing(certified / "board-host.json5", stand_in())
    with far, spots.open("zenoh:a1") as board:
        assert next(iter(board.touches())).position_um == 42_500
        assert board.command("get")["gain"] == 9
