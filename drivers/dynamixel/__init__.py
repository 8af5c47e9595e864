"""Dynamixel servos on protocol 2.0: registers as data, a bus that no fault confuses, a stage made of servos."""
