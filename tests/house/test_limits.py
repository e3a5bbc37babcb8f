"""Each limit that README and the site state has a check, and a test that crosses it: see `CROSSED`."""

import ast
import re
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
SITE = "examples/site"
PAGES = ["README.md", *(f"{SITE}/{name}.md" for name in ("limits", "yield-and-plastic-zones", "friction", "statics"))]

# How each sentence about limits begins, and the tests of what warns, raises or tells where one crosses it. A sentence
# without tests says what is possible, where another one leads, or how exact a number is.
CROSSED = {
    "README.md": {
        "Contact acts between the patches": ["exudyn_contacts/test_run_record.py::test_the_edge_of_a_patch_is_told"],
        "It wanders over whole faces": [],
        "Sharp edges that": ["simulation/reviews/test_penetration.py::test_edges_that_no_row_holds_are_told"],
        "Bodies are linear elastic and isotropic": [
            "meshing/test_deck_materials.py::test_what_a_deck_does_not_say_is_named",
            "simulation/test_large_strain.py::test_a_bar_that_strains_by_a_third_bounces_as_linear_theory_says",
        ],
        "They yield in": [
            "exudyn_contacts/test_yield.py::test_first_yield_is_told_once_and_only_beyond_it",
            "simulation/reviews/test_bending.py::test_a_link_that_bends_beyond_yield_is_told",
        ],
        "Rotation stiffens and compression softens": [
            "simulation/reviews/test_spin.py::test_the_share_that_is_told_is_that_of_geometric_stiffness",
            "reduction/test_buckling.py::test_a_column_under_load",
        ],
        "In an inertial frame a body may turn": [
            "simulation/test_solve.py::test_large_rotation_warns",
            "simulation/test_solve.py::test_a_body_that_has_turned_before_it_hits_warns",
            "simulation/test_modes.py::test_a_ball_in_an_inertial_frame_says_that_it_does_not_roll",
        ],
        '`frame="floating"` turns freely': [],
        "The kept modes have no damping": [
            "simulation/reviews/test_review.py::test_vibration_that_lasts_without_damping_is_told"
        ],
        "In contacts, only": ["exudyn_contacts/test_viscosity.py::test_what_has_no_time_is_told"],
        "A static answer exists": [],
        "A force on any other node": [
            "simulation/reviews/test_dents.py::test_what_a_sensor_misses_is_told",
            "simulation/reviews/test_dents.py::test_a_stiff_spring_finds_a_body_too_stiff",
            "exudyn_bodies/test_markers.py::test_misuse",
        ],
        "Meshes consist of": ["meshing/test_mesh_files.py::test_unusable_elements"],
        "Linear ones make": ["fe/test_walls.py::test_linear_elements_that_make_a_strip_too_stiff_warn"],
        '`formulation="lagrange"` needs': [
            "exudyn_contacts/test_multipliers.py::test_multipliers_take_explicit_steps_of_nanoseconds"
        ],
    },
    f"{SITE}/limits.md": {
        "A body with markers in an inertial frame": [
            "exudyn_bodies/test_attachments.py::test_a_pendulum_in_an_inertial_frame_says_what_it_needs"
        ],
        "In a floating frame, bodies on which": [
            "exudyn_bodies/test_joints.py::test_bodies_tell_what_mass_forces_act_on"
        ],
        "This matters for bodies that vibrate": [
            "exudyn_bodies/test_joints.py::test_bodies_tell_what_mass_forces_act_on"
        ],
        "Compression softens bending": ["reduction/test_buckling.py::test_a_column_under_load"],
        "Without it, a run warns": [
            "reduction/test_buckling.py::test_a_column_under_load",
            "simulation/reviews/test_spin.py::test_the_share_that_is_told_is_that_of_geometric_stiffness",
        ],
        "With it, links warn": ["exudyn_bodies/test_stiffening.py::test_a_buckled_strut_warns_of_its_slopes"],
        "Bodies with geometric stiffness keep": [
            "exudyn_bodies/test_joints.py::test_bodies_tell_what_mass_forces_act_on"
        ],
        "[Growth by rotation]": [
            "exudyn_bodies/test_body_results.py::test_markers_on_nodes_move_by_the_coordinates_alone"
        ],
        "Contact and results have it": [],
        "A [sharp edge]": [
            "simulation/reviews/test_penetration.py::test_a_corner_or_edge_that_sinks_into_a_rigid_surface_is_told"
        ],
        "A warning tells when one does": [
            "simulation/reviews/test_penetration.py::test_an_edge_at_the_end_of_a_patch_that_sinks_is_told"
        ],
        "Nothing holds a body beside": [
            "simulation/reviews/test_passing.py::test_a_body_that_turned_and_falls_into_another_warns"
        ],
        "A warning tells when one enters": [
            "simulation/reviews/test_passing.py::test_a_body_that_turned_and_falls_into_another_warns"
        ],
        "Nothing holds it behind a thin wall": [
            "simulation/reviews/test_through_walls.py::test_a_jump_through_a_sheet_is_told",
            "simulation/reviews/test_through_walls.py::test_a_body_that_sinks_through_an_elastic_sheet_is_told",
        ],
        "Springs, joints and sensors": [
            "simulation/reviews/test_dents.py::test_what_a_sensor_misses_is_told",
            "simulation/reviews/test_dents.py::test_a_stiff_spring_finds_a_body_too_stiff",
        ],
        "That is estimated": ["simulation/reviews/test_dents.py::test_what_a_sensor_misses_is_told"],
        "A load alone": ["simulation/reviews/test_dents.py::test_what_a_sensor_misses_is_told"],
        "Forces between two elastic bodies lack": [],
        "So rows that roll over facets": [],
        "Without `damping=`, a run": [
            "simulation/reviews/test_review.py::test_vibration_that_lasts_without_damping_is_told"
        ],
        "Nor do patches with": ["exudyn_contacts/test_shared_patches.py::test_contacts_that_yield_share_no_patch"],
        "A body that [touches itself]": ["exudyn_contacts/test_self_contact.py::test_what_is_not_supported"],
    },
    f"{SITE}/yield-and-plastic-zones.md": {
        'Bases "contact-adapted"': [],
        "The paper's basis": ["exudyn_contacts/test_plastic_nodes.py::test_what_knows_no_nodes_that_yield_is_refused"],
        '"craig-bampton" does not': ["plasticity/test_zone.py::test_zone_by_default_and_where_it_is_refused"],
        "Contacts by penalty": ["exudyn_contacts/test_plastic_impact.py::test_what_cannot_yield_is_refused"],
        "Zones of two patches": [
            "exudyn_contacts/test_plastic_impact.py::test_flow_of_two_zones_near_each_other_warns"
        ],
        "A `ModelLimitWarning` tells": [
            "exudyn_contacts/test_plastic_impact.py::test_flow_of_two_zones_near_each_other_warns"
        ],
        "Further apart": [],
        "`contact.area` and": [],
        "Where flow is fully plastic": [],
        "Plasticity is at small strain": [
            "exudyn_contacts/test_plastic_impact.py::test_plastic_strain_that_is_not_small_is_told",
            "exudyn_contacts/test_plastic_impact.py::test_flow_at_the_edge_of_the_zone_warns",
        ],
        "Elsewhere a warning tells": [
            "exudyn_contacts/test_yield.py::test_first_yield_is_told_once_and_only_beyond_it",
            "simulation/reviews/test_bending.py::test_a_link_that_bends_beyond_yield_is_told",
        ],
        "Bodies of several materials": [],
    },
    f"{SITE}/friction.md": {"With friction there is no potential": []},
    f"{SITE}/statics.md": {
        "What nothing holds": ["simulation/test_statics.py::test_what_nothing_holds_has_no_equilibrium"],
        "Nor has a stack": [
            "simulation/test_settle.py::test_what_cannot_rest_is_refused_and_the_model_stays_as_it_was"
        ],
        "What touches and is pushed": ["simulation/test_statics.py::test_a_block_that_only_stands_carries_its_weight"],
        "If a load step": [],
        "If that does not help": [
            "simulation/test_statics.py::test_forces_that_settle_in_no_load_step_are_named_as_the_cause"
        ],
        "The result has samples": [],
        "Friction and plastic flow": [],
        "Take more load steps": [],
        "Multipliers (": ["simulation/test_statics.py::test_multipliers_are_refused_before_the_first_step"],
        "A warning tells if": ["exudyn_bodies/test_stiffening.py::test_statics_tell_that_a_straight_strut_has_buckled"],
        "Reactions of joints keep": [],
        "`ep.solve_static` and `ep.natural_modes` know": [],
        "Exudyn's own `mbs.SolveStatic` and": [],
        "A link that starts near": ["simulation/test_held_bodies.py::test_a_link_on_its_hinge_is_unstable"],
    },
}
TELLING = "warns(", "raises(", "left_out", "caught", "refused(", "spun("


def stated(page):
    """Sentences of a page's bullets about limits; after them comes no heading but the next one."""
    text = (ROOT / page).read_text()
    start = text.index("# Limits" if page.endswith("limits.md") else "## Limits\n")
    section = re.split(r"\n## ", text[start:].removeprefix("## "))[0]
    bullets = [re.sub(r"\s+", " ", bullet) for bullet in re.findall(r"^- (.*?)(?=^- |^$|\Z)", section, re.M | re.S)]
    return [sentence for bullet in bullets for sentence in re.split(r"(?<=\.) (?=[A-Z`\"])", bullet.strip())]


@pytest.mark.parametrize("page", PAGES)
def test_each_limit_has_a_check_and_a_test_that_crosses_it(page):
    known, sentences = CROSSED[page], stated(page)
    assert sentences
    for sentence in sentences:
        found = [begin for begin in known if sentence.startswith(begin)]
        assert len(found) == 1, f"{page}: name the check and the test of this limit in CROSSED: {sentence}"
    for begin in known:
        assert any(sentence.startswith(begin) for sentence in sentences), f"{page} says no longer: {begin}"


@pytest.mark.parametrize(
    "test", sorted({test for known in CROSSED.values() for tests in known.values() for test in tests})
)
def test_it_is_there_and_looks_at_what_is_told(test):
    path, name = test.split("::")
    source = (ROOT / "tests" / path).read_text()
    (found,) = [part for part in ast.parse(source).body if isinstance(part, ast.FunctionDef) and part.name == name]
    assert any(word in ast.get_source_segment(source, found) for word in TELLING)
