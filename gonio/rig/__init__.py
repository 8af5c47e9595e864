"""What a rig must offer: devices, kinematics, motion planning, safety envelope, clock."""
