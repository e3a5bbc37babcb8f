"""Runs by Exudyn's solvers: steps, checks before, and the result; `reviews` look at runs afterwards.

- `solve`, `statics` and `settling` are the runs that users call, `run_plan` what a dynamic run is to be. `hooks` act
  within Exudyn's steps, `causes` say what its errors mean. `compiled_run` makes runs by package `compiled`, of
  models that `compiled_limits` allows.
- Steps: `stability` and `item_limits` have the largest ones, `step_choice` chooses, `step_control` adapts them with
  `contact_work`, `velocity_error` and `vibration`. Newton's method ends at a residual of `newton_goal`.
- Checks before: `joint_checks`, `sensor_checks`.
- After: `result`, `stored_run` for files, `continuation` for runs that go on, `collect` for runs that users made.
"""
