"""What is implausible about a body."""

from hbm.body import build_body
from hbm.plausibility.motion import implausible
from tests.hbm.people import person
from tests.synthetic import MASS_KG, T_POSE_MM, synthetic_body


def test_a_plausible_body_raises_no_warning():
    assert implausible(synthetic_body()) == ()


def test_legs_of_different_length_are_noticed():
    short = {
        n: (*T_POSE_MM[n][:2], T_POSE_MM[n][2] + 40) for n in ("LLM", "LMM", "LHEE", "LMT2", "LMT5")
    }
    body = build_body(person(**short), mass=MASS_KG)
    (note,) = implausible(body)
    assert (note.code, note.level) == ("legs_differ", "warning")
