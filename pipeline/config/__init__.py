"""What people type: studies, subjects, settings, checked."""
