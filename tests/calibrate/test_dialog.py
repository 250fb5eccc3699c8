"""Calibration sessions work with any dialog: a terminal, or a web UI in another thread."""

import argparse
import queue
import threading

import pytest
from support.refusals import refusal

from spots.calibrate.session import steps
from spots.calibrate.session.bench import Bench
from spots.calibrate.session.dialog import UndoError
from spots.calibrate.session.session_file import Session
from spots.errors import StateError
from spots_sim.person.stage import Stage
from spots_sim.person.stage_presser import StagePresser

pytestmark = pytest.mark.board

OPTIONS = argparse.Namespace(channels="F3,F4,F5,F6,F7,F8", keep_settings=True)


class Recorded:
    """A dialog that records what a session shows, and raises the errors that a test sets."""

    def __init__(self):
        self.said, self.wanted, self.answers = [], [], queue.Queue()
        self.raises = {}  # number of presses asked for: exception

    def begin(self, title, total, plan, length_um):
        self.said.append(title)

    def skip(self, count=1):
        pass

    def want(self, wanted):
        self.wanted.append(wanted)

    def watch(self, reading, trouble, steady):
        if error := self.raises.pop(len(self.wanted), None):
            raise error

    def taken(self, wanted, reading):
        self.said.append(f"taken {wanted}")

    def fitted(self, progress):
        pass

    def say(self, text):
        self.said.append(text)

    def ask(self, question):
        self.said.append(question)
        answer = self.answers.get(timeout=30)
        if isinstance(answer, Exception):
            raise answer
        return answer


def take(stage, path, dialog, kind="position"):
    presser = StagePresser(stage)
    bench = Bench(stage.reader, presser, dialog, stage.length_um, path.with_suffix(".toml"))
    count = {"position": 12, "joint": 4}[kind]
    steps.calibrate(bench, Session(path), kind, count, None, OPTIONS)


def test_undo_drops_the_last_press_and_asks_for_it_again(sensor, tmp_path):
    path, dialog = tmp_path / "a.jsonl", Recorded()
    dialog.raises = {1: UndoError(), 6: UndoError()}
    with Stage(sensor, seed=2) as stage:
        take(stage, path, dialog)
    assert "there is no press to undo" in dialog.said
    places = [round(wanted.place_um / 1000, 1) for wanted in dialog.wanted]
    assert places[:8] == [0, 0, 7.7, 15.5, 23.2, 30.9, 23.2, 30.9]
    assert any(text.startswith("undone: 23.2 mm with 6 N") for text in dialog.said)
    taken = [p.place_um for p in Session(path).points]
    assert len(taken) == 12
    assert taken == sorted(set(taken))


def test_a_session_ends_where_its_dialog_ends_it_and_continues_later(sensor, tmp_path):
    path, dialog = tmp_path / "a.jsonl", Recorded()
    dialog.raises = {4: StateError("the session was ended")}
    with Stage(sensor, seed=2) as stage:
        with refusal(StateError):
            take(stage, path, dialog)
        assert len(Session(path).points) == 3
        stage.release()
        take(stage, path, dialog)
    assert len(Session(path).points) == 12


def test_a_release_that_does_not_come_can_be_ended(sensor, tmp_path):
    dialog = Recorded()
    with Stage(sensor, seed=2) as stage:
        presser = StagePresser(stage)
        presser.patience_s = 60.0
        presser.release = lambda: dialog.raises.update({1: StateError("ended")})
        bench = Bench(stage.reader, presser, dialog, stage.length_um, tmp_path / "a.toml")
        with refusal(StateError):
            steps.calibrate(bench, Session(tmp_path / "a.jsonl"), "position", 12, None, OPTIONS)


def test_a_session_blocks_on_an_answer_from_another_thread(sensor, tmp_path):
    dialog, found = Recorded(), []
    options = argparse.Namespace(channels="F3,F4,F5,F6,F7,F8", keep_settings=True)

    def session():
        with Stage(sensor, seed=2) as stage:
            presser = StagePresser(stage)
            presser.least_mN = lambda wanted, reader: 1000 * float(dialog.ask("least force?"))
            bench = Bench(stage.reader, presser, dialog, stage.length_um, tmp_path / "a.toml")
            steps.calibrate(bench, Session(tmp_path / "a.jsonl"), "force", 14, None, options)
        found.append(Session(tmp_path / "a.jsonl").points)

    thread = threading.Thread(target=session)
    thread.start()
    dialog.answers.put("0.4")
    thread.join(60)
    assert "least force?" in dialog.said
    assert len(found[0]) == 42
    assert min(p.force_mN for p in found[0]) == pytest.approx(420)


def test_two_undo_requests_drop_two_presses(sensor, tmp_path):
    path, dialog = tmp_path / "a.jsonl", Recorded()
    dialog.raises = {5: UndoError()}
    with Stage(sensor, seed=2) as stage:
        presser = StagePresser(stage)
        released = presser.release

        def release():
            if len(dialog.wanted) == 5 and "undone" not in str(dialog.said[-2]):
                presser.release = released
                dialog.raises = {5: UndoError()}
            else:
                released()

        presser.release = release
        bench = Bench(stage.reader, presser, dialog, stage.length_um, tmp_path / "a.toml")
        steps.calibrate(bench, Session(path), "position", 0, None, OPTIONS)
    undone = [text for text in dialog.said if text.startswith("undone: ")]
    assert len(undone) == 2
    assert len(Session(path).points) == 17
