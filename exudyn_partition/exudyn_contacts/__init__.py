"""Contacts of partition bodies in an Exudyn model: the object that holds their forces, and their data of each run.

- To make contacts: `create_contact` adds items, of a `contact_plan`; `contact_pairs`, `point_pairs` and `coupling` say
  which there are, and which are solved together. `contact_object` is the object of the model that has their forces.
- In a run: a `model_run` has groups (`group_run`) of contacts (`contact_run`), and `central_differences` the
  multipliers. `run_state` is what goes on; `run_record` and `contact_record` only grow. `broad_phase` lets contacts
  sleep that are far from touching.
- After it: `partition_contact` is what users ask. It reads `row_samples`, `friction_results`, `plastic_results` and
  `contact_replay`; `balance` sums up energies.
"""
