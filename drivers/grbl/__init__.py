"""Stepper controllers that run Grbl 1.1, FluidNC or grblHAL, over a serial port."""
