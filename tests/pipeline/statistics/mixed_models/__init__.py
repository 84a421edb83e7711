"""Mixed models by lme4, lmerTest and pbkrtest: designs, script, numbers."""
