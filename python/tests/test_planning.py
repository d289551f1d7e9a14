"""Doses, objectives and plans."""

import numpy as np
import pytest
import stillpoint_rt as st
from conftest import command
from scipy.optimize import minimize

ANGLES = [0.0, 72.0, 144.0, 216.0, 288.0]


@pytest.fixture(scope="module")
def setup():
    # Coarse points and wide bixels, so that the tests are fast.
    return st.Case.phantom(0).setup(grid_mm=12, bixel_mm=20, angles=36)


@pytest.fixture(scope="module")
def beams(setup):
    return setup.beams(ANGLES)


@pytest.fixture(scope="module")
def solved(beams):
    plan = beams.solve()
    plan.grid_mm = 6.0
    return plan


def test_a_case_has_its_image_structures_and_prescription():
    case = st.Case.phantom(0)
    structures = case.structures()
    assert {"target", "organ", "external"} <= set(structures["role"])
    (target,) = case.prescription
    mask = case.mask(target)
    assert mask.shape == case.hu.shape == case.shape
    volume = mask.sum() * np.prod(case.spacing_mm) * 1e-3
    assert volume == pytest.approx(structures.loc[target, "volume_cm3"])
    with pytest.raises(st.StillpointError, match="it has"):
        case.mask("Nothing")


def test_a_case_file_is_the_case_that_was_written(tmp_path):
    command("case", "phantom", "--seed", "3", "--out", tmp_path)
    read = st.Case.read(tmp_path / "pelvis-3.case")
    assert (read.hu == st.Case.phantom(3).hu).all()
    with pytest.raises(st.StillpointError):
        st.Case.read(tmp_path / "nothing.case")


def test_the_matrix_is_sparse_by_points_and_bixels(setup, beams):
    dose = setup.dose(ANGLES)
    assert dose.shape == (setup.points, len(beams)) and dose.dtype == np.float32
    assert dose.nnz and (dose.data > 0).all()
    assert set(beams.beam_of) == set(range(5)) and beams.bixels_mm.shape == (len(beams), 2)


def test_a_chest_by_pencil_beams_has_a_note_and_by_superposition_other_doses():
    lung = st.Case.phantom(0, "lung")
    pencil = lung.setup(grid_mm=15, bixel_mm=20, angles=12)
    assert any("pencil beams" in note for note in pencil.notes)
    superposition = lung.setup(grid_mm=15, bixel_mm=20, angles=12, engine="superposition")
    assert not any("pencil beams" in note for note in superposition.notes)
    sums = [setup.dose([0.0]).sum() for setup in (pencil, superposition)]
    assert sums[1] != sums[0]
    with pytest.raises(st.StillpointError, match="pencil, superposition"):
        lung.setup(engine="cones")


def test_the_slope_is_the_difference_quotient_of_the_cost(beams, solved):
    random = np.random.default_rng(0)
    weights = solved.weights + random.random(len(beams))
    cost, slope = beams.cost(weights)
    direction = random.standard_normal(len(beams))
    ahead, behind = (beams.cost(weights + step * direction)[0] for step in (1e-5, -1e-5))
    assert (ahead - behind) / 2e-5 == pytest.approx(slope @ direction, rel=1e-5)
    with pytest.raises(st.StillpointError, match="weights"):
        beams.cost(weights[1:])


def test_an_optimiser_of_scipy_reaches_the_shipped_plan(beams, solved):
    found = minimize(
        beams.cost,
        np.full(len(beams), solved.weights.mean()),
        jac=True,
        method="L-BFGS-B",
        bounds=[(0, None)] * len(beams),
        options={"maxiter": 2000, "maxfun": 4000, "ftol": 1e-12},
    )
    assert solved.cost <= found.fun * (1 + 1e-3), "the shipped solver is at the optimum"
    assert found.fun < 1.02 * solved.cost
    own = beams.plan(found.x)
    assert own.cost == pytest.approx(found.fun)


def test_what_a_fluence_gives_is_in_frames(setup, beams, solved):
    dvh, figures = solved.dvh(), solved.figures()
    (target,) = setup.case.prescription
    prescribed = setup.case.prescription[target]
    assert (dvh.iloc[0] > 0.99).all() and (dvh.diff().dropna() <= 1e-12).all().all()
    assert figures.loc[target, "d50_gy"] == pytest.approx(prescribed, rel=0.05)
    assert figures.loc[target, "covered"] > 0.9
    dose = solved.dose
    assert dose.ndim == 3 and 1.0 < dose.max() / prescribed < 1.3
    # Half of the fluence is half of the dose.
    half = beams.plan(solved.weights / 2)
    half.grid_mm = 6.0
    np.testing.assert_allclose(half.dose, dose / 2, rtol=1e-5, atol=1e-5)


def test_own_objectives_go_before_the_shipped_ones(setup):
    objectives = st.Objectives().want("Rectum", overdose={"dose": "10 Gy", "weight": 500})
    strict = setup.case.setup(grid_mm=12, bixel_mm=20, objectives=objectives)
    table = strict.objectives()
    (rectum,) = table[table["structure"] == "Rectum"]["objective"]
    assert 10 in rectum["overdose"].values() and (table["structure"] == "Bladder").any()
    rows, volumes = strict.rows_of("Rectum")
    spare, usual = (s.beams(ANGLES).solve() for s in (strict, setup))
    mean = [(b.beams.dose @ b.weights)[rows] @ volumes / volumes.sum() for b in (spare, usual)]
    assert mean[0] < mean[1]
    with pytest.raises(st.StillpointError, match="unknown variant"):
        setup.case.setup(objectives=st.Objectives().want("Rectum", overdoes={}))


def test_a_search_finds_beams(setup):
    plan = setup.plan("equidistant", beams=3, budget=3)
    assert len(plan.angles) == 3 and 1 <= len(plan.history) <= 3
    assert plan.cost == min(cost for _, cost in plan.history)
    # The objective of its weights is the one that the search states.
    assert plan.beams.cost(plan.weights)[0] == pytest.approx(plan.cost, rel=1e-6)
    with pytest.raises(st.StillpointError, match="unknown method"):
        setup.plan("guess")
