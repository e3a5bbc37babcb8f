"""Contacts of partition bodies in an Exudyn model: the object that holds their forces, and their data of each run."""
