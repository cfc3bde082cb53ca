"""Questions of a protocol: asked while nothing moves, answered by a person or a program, and recorded."""

import threading
import tomllib

import pytest

from dic.runfile.reader import RunFile
from drivers.errors import DeviceError
from rig.commands.plan import plan_dict, plan_lines
from rig.engine.engine import Engine
from rig.plan import make_plan
from rig.protocol.protocol import parse_protocol
from rig.replay.replay import replay_run
from rig.resume import read_earlier
from tests.rig.conftest import FakeRig
from tests.rig.engine.test_phases import SLOW
from tests.rig.protocol.test_phases import HOLD, TURNING, mistakes, text
from tests.rig.replay.test_replay import identical

ASK = """
[[phases]]
do = "ask"
text = "Please take the extensometer off."
word = "off"
"""
AGAIN = '[[phases]]\ndo = "to-load"\nload_n = 6000.0\nrate_n_s = 200.0\n'
DEFINITION = text(HOLD + ASK + AGAIN, SLOW)


@pytest.fixture
def rig(tmp_path) -> FakeRig:
    return FakeRig(parse_protocol(tomllib.loads(DEFINITION)), tmp_path / "run.h5", definition=DEFINITION)


def test_the_machine_is_held_while_the_operator_is_asked(rig):
    seen = []

    def answer(question):
        seen.append((question.text, question.word, rig.calls[-2], engine.waiting_for_operator))
        seen.append((engine.status.state.name, str(engine.status.step)))
        rig.clock.sleep(600.0)
        seen.append(engine.status.reading.time_s)

    rig.operator.on_ask = answer
    engine = rig.engine()
    outcome = engine.run()
    assert (outcome.status, outcome.reason) == ("completed", "")
    assert seen[0] == ("Please take the extensometer off.", "off", "hold", True)
    assert seen[1] == ("PREPARING", "step 6 (ask)")
    # the machine was read until the answer
    assert seen[2] > rig.clock.now_s() - 600.0
    assert not engine.waiting_for_operator
    events = rig.events()
    assert "the operator is asked: Please take the extensometer off." in events
    assert '"off" by the operator after 600.0 s' in events
    assert "reached without images: step 6" in events
    with RunFile(rig.path) as run:
        assert [step.index for step in run.steps] == [0, 1, 2, 3, 4, 5, 7]


def test_a_program_may_answer_and_the_question_at_the_terminal_is_withdrawn(rig):
    withdrawn = threading.Event()
    answers = []

    def wait(question):
        answers.append(engine.answer("removed", "HTTP"))
        answers.append(engine.answer(" OFF ", "HTTP"))
        # on simulated time, the engine wakes when this thread lets time pass
        rig.clock.sleep(600.0)
        assert withdrawn.wait(60.0)
        raise DeviceError("operator", "answer", "a word", "none", "")

    rig.operator.on_ask, rig.operator.on_withdraw = wait, withdrawn.set
    engine = rig.engine()
    outcome = engine.run()
    assert outcome.status == "completed", outcome.reason
    assert answers == ['expected the word "off", got "removed"', ""]
    assert any(event.startswith('"off" by HTTP after') for event in rig.events())
    assert engine.answer("off", "HTTP") == "no question of the protocol waits for an answer"


def test_a_load_that_breaks_the_specimen_ends_the_run_during_a_question(rig):
    frame = rig.load_frame
    rig.operator.on_ask = lambda question: rig.clock.sleep(3600.0)

    def torn(_, state):
        asked = "ask off" in rig.calls
        return type(state)(**{**vars(state), "load_n": 100.0}) if asked else state

    frame.on_read = torn
    outcome = rig.engine().run()
    assert outcome.status == "failed"
    assert "step 6 (ask): expected a load above" in outcome.reason
    assert "withdraw" in rig.calls


def test_a_refusal_ends_the_run(rig):
    def refuse(question):
        raise DeviceError("operator", "answer a question", 'the word "off"', "no answer", "start again")

    rig.operator.on_ask = refuse
    outcome = rig.engine().run()
    assert outcome.status == "failed"
    assert 'expected the word "off", got no answer' in outcome.reason


def test_a_question_is_replayed_and_a_run_that_ended_in_it_asks_again(rig, tmp_path, monkeypatch):
    rig.operator.on_ask = lambda question: rig.clock.sleep(30.0)
    assert rig.engine().run().status == "completed"
    replayed = replay_run(rig.path, tmp_path / "new.h5")
    assert (replayed.outcome.status, replayed.differences) == ("completed", [])
    identical(rig.path, tmp_path / "new.h5")

    ended = FakeRig(rig.protocol, tmp_path / "ended.h5", definition=DEFINITION)
    engine = ended.engine()
    ended.operator.on_ask = lambda question: engine.abort("enough") or ended.clock.sleep(30.0)
    assert engine.run().status == "aborted"
    earlier = read_earlier(ended.path, DEFINITION, "")
    assert (earlier.next.index, earlier.next.kind) == (6, "ask")

    further = FakeRig(rig.protocol, tmp_path / "further.h5", definition=DEFINITION)
    further.load_frame.displacement_mm = 0.29
    assert further.engine(earlier=earlier.readings).run().status == "completed"
    asked = [call for call in further.calls if call in ("GO_ON", "ask off", "load 6000")]
    assert asked == ["GO_ON", "ask off", "load 6000"]


def test_an_operator_who_cannot_be_asked_is_refused_before_anything_moves(rig):
    class Old:
        perform = staticmethod(rig.operator.perform)

    rig.operator = Old()
    outcome = rig.engine().run()
    assert outcome.status == "failed"
    assert "one whose driver has no method ask" in outcome.reason
    assert "ATTACH_GRID" not in rig.calls


def test_a_protocol_that_turns_or_only_asks_may_ask(tmp_path):
    turn = '[[phases]]\ndo = "rotate"\nangle_deg = 10.0\n'
    rest = '[[phases]]\ndo = "hold"\nkeep = "angle"\nduration_s = 5.0\n'
    for name, phases in {"turn": ASK + turn + ASK, "rest": ASK + rest}.items():
        made = FakeRig(parse_protocol(tomllib.loads(text(phases, TURNING))), tmp_path / f"{name}.h5")
        outcome = made.engine().run()
        assert outcome.status == "completed", outcome.reason
        assert made.calls.count("ask off") == phases.count('"ask"')


def test_the_plan_shows_the_questions(rig):
    plan = make_plan(rig.protocol)
    line = next(line for line in plan_lines(plan) if " ask " in line)
    assert 'asks "Please take the extensometer off.", word off' in line
    assert plan_dict(plan)["steps"][6]["question"] == {
        "text": "Please take the extensometer off.",
        "word": "off",
    }
    assert plan_dict(plan)["steps"][5]["question"] is None


@pytest.mark.parametrize(
    ("key", "said"),
    [
        ('text = ""', "phase 1 (ask): text: string should have at least 1 character"),
        ('text = "a\\nb"', "a text without control characters"),
        ('text = "Off?"\nword = "take off"', "phase 1 (ask): word: string should match pattern"),
        ('text = "Off?"\nword = ""', "phase 1 (ask): word"),
        ('text = "Off?"\nanswer = "off"', "phase 1 (ask): answer: unknown key"),
    ],
)
def test_a_question_that_cannot_be_shown_or_answered_is_a_mistake(tmp_path, key, said):
    assert said in mistakes(tmp_path, f'[[phases]]\ndo = "ask"\n{key}\n', TURNING)


def test_an_engine_takes_no_answer_before_its_run(rig):
    engine: Engine = rig.engine()
    assert engine.answer("off", "HTTP") == "no question of the protocol waits for an answer"
    assert engine.question is None
