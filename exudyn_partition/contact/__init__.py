"""Gaps between moving patches, gaps to rigid surfaces, and the generalised forces of contact (paper, eq. 21-28).

Rows G_C of gaps are in `gaps`, the multipliers in `formulations`. Places of points and single gaps (eq. 19, 20) are in
package `surfaces`.

A contact in a run is a `patch_contact.PatchContact`: from its `state` it answers with an `evaluation`. Its law (`law`,
`formulations`) finds forces on rows, from where the rows are:

- `gaps` is what all gaps have in common; `patch_gaps` are those to another patch, `wandering` those over large patches,
  `rigid`, `profile` and `rigid_mesh` those to rigid surfaces, `spot_gaps` the gap at a point by the true surfaces;
- `stages`, `followed` and `linear_gaps` have which rows are present at the moment, `normal_rows` and `tangential` their
  directions, `side` the patch of a body, `pairings` the pairs at the start;
- `between` is the flexibility between contacts on common bodies, `viscosity` that which yields with time, `plasticity`
  the zones that flow.
"""
