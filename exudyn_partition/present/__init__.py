"""What a user looks at: plots, ParaView files, Exudyn's renderer and the report page."""
