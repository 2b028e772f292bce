"""Four legs told where the recording shows three: one was cut in two, and all was "trust"."""

import importlib
import warnings

import pytest

import lightflight as lf
from lightflight.path.verdict import FindingName, Level
from tests.labs import one_leg, three_legs


@pytest.fixture(scope="module")
def recorded():
    lab = three_legs()
    return lab, lab.recording(4, 20_000.0)


def reconstructed(recorded, n_legs):
    lab, hist = recorded
    told = {"camera": lab.camera, "source": lab.known, "timing": lab.timing}
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        return lf.reconstruct(hist, n_legs=n_legs, **told)


def test_the_number_is_doubted(recorded):
    path = reconstructed(recorded, 4)
    assert path.n_legs == 4
    assert path.verdict.level is not Level.TRUST
    (finding,) = [one for one in path.verdict.findings if one.name is FindingName.LEG_COUNT]
    assert "4 legs were told and the recording shows 3" in finding.sentence
    assert FindingName.UNSEEN_LEG in [one.name for one in path.verdict.findings]


def test_how_many_are_seen_is_kept_where_diffuse_light_moves_the_path(monkeypatch):
    """Legs are then fitted from anew, by a fit that knows nothing of what was told."""
    diffuse, examine = (
        importlib.import_module(f"lightflight.reconstruct.{name}")
        for name in ("other_light.diffuse", "verdict.examine")
    )
    far, seen, usual = iter([100.0]), [], examine.noticed
    monkeypatch.setattr(diffuse, "moved_stds", lambda *_: next(far, 0.0))

    def noticed(*given, n_shown, **told):
        seen.append(n_shown)
        return usual(*given, n_shown=n_shown, **told)

    monkeypatch.setattr(examine, "noticed", noticed)
    lab = one_leg()
    reconstructed((lab, lab.recording(4, 4000.0)), 2)
    assert next(far, None) is None
    assert seen == [1]


def test_the_true_number_is_not(recorded):
    path = reconstructed(recorded, 3)
    assert FindingName.LEG_COUNT not in [one.name for one in path.verdict.findings]
    assert path.verdict.level is Level.TRUST
