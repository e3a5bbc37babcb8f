"""Partition bodies in an Exudyn model: nodes, objects, markers, joints and carriers."""
