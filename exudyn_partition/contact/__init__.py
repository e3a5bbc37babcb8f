"""Gaps between moving patches, gaps to rigid surfaces, and the generalised forces of contact (paper, eq. 21-28).

Rows G_C of gaps are in `gaps`, the multipliers in `formulations`. Places of points and single gaps (eq. 19, 20) are in
package `surfaces`.
"""
