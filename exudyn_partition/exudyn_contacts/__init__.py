"""Contacts of partition bodies in an Exudyn model: the object of their forces, groups, and what they keep of a run."""
