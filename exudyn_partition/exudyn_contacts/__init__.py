"""Contacts of partition bodies in an Exudyn model: force elements, groups, and what they keep of a run."""
