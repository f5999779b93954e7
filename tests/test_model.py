"""The buffer and a slow model of tf2, side by side; and the model beside the recordings of the real tf2."""

import pytest
from model import S, Model, ModelError
from test_conformance import SCENARIOS, assert_same_answer, assert_same_reason, number

pytestmark = pytest.mark.ours


def called(model, op, args):
    """What `call` of test_conformance returns for a buffer."""
    match op:
        case "set":
            static, authority, parent, child, sec, nanosec, xyz, xyzw = args
            xyz, xyzw = (tuple(float(number(a)) for a in vector) for vector in (xyz, xyzw))
            model.insert(parent, child, sec * S + nanosec, xyz, xyzw, authority, static)
            return None
        case "lookup":
            return as_recorded(model.lookup(*args))
        case "lookup_full":
            return as_recorded(model.lookup_full(*args))
        case "can":
            return list(model.can(*args))
        case "can_full":
            return list(model.can_full(*args))
        case "latest":
            return model.latest(*args)
        case "dot":
            return "".join(f'"{parent}" -> "{child}"' for parent, child in model.edges())
        case "frames":
            return sorted(model.names)
        case "exists":
            return model.exists(*args)
        case "yaml":
            return repr(model.yaml())
        case "string":
            return model.string()
        case "clear":
            return model.clear()
    raise AssertionError(f"unknown recording {op}")


def as_recorded(answer):
    stamp, target, source, xyz, xyzw = answer
    return [*divmod(stamp, S), target, source, list(xyz), list(xyzw)]


@pytest.mark.parametrize("scenario", SCENARIOS, ids=lambda scenario: scenario["name"])
def test_the_model_answers_as_tf2_did(scenario):
    model = Model(scenario["cache_ns"])
    for (op, *args), want in zip(scenario["ops"], scenario["want"], strict=True):
        try:
            got = called(model, op, args)
        except ModelError as error:
            assert error.kind == want.get("err"), (op, args, error)
            assert_same_reason(error.text, want["msg"])
        else:
            assert "ok" in want, (op, args, got)
            assert_same_answer(op, got, want["ok"])
