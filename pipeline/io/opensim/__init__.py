"""OpenSim's files: TRC, MOT and STO -> `Recording`."""
