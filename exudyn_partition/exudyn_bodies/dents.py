"""Bodies that have yielded before: plastic strain of their patches at the start, and the shape that it gives them."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from ..contact.plasticity.zone_run import ZoneMotion
from ..errors import InputError
from ..plasticity.flow import PlasticState, validate_state
from ..support.foreign import MainSystem
from .partition_body import PartitionBody


def set_plastic_states(mbs: MainSystem, item: PartitionBody, states: Mapping[int | str, PlasticState]) -> None:
    """Let the plastic zones of a body begin with these states, and the body with the shape that they give it at rest.

    Parameters
    ----------
    mbs : exudyn.MainSystem
    item : PartitionBody
    states : dict of int or str to PlasticState
        By the number or name of the patch.

    Raises
    ------
    InputError
        If a patch has no plastic zone, or the state is of another one.
    """
    if not isinstance(states, Mapping):
        raise InputError(f"plasticStates: expected a dict of patch: PlasticState, got {type(states).__name__}")
    forces = []
    for key, state in states.items():
        patch = item.body.partition.patch(key)
        motion = ZoneMotion.of(item.kinematics, patch)
        if motion is None:
            raise InputError(
                f"plasticStates: patch {patch} of the body has no plastic zone. Give hardening= to its "
                "material, and reduce it with basis 'contact-adapted' or 'residual'"
            )
        item.plastic_states[patch] = validate_state("plasticStates", state, len(motion.zone))
        forces.append(motion.kinematics.rows.T @ motion.zone.pseudo_forces(state.strain))
    if not forces:
        return
    force = np.sum(forces, axis=0)
    omega = item.body.basis.omega[item.body.n_shapes - len(force) :]
    elastic = omega > 0
    if elastic.any():
        shape = np.zeros(len(force))
        shape[elastic] = force[elastic] / omega[elastic] ** 2
        mbs.SetNodeParameter(item["nModal"], "initialCoordinates", shape)
