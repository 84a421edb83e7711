"""The base of everything that a user types."""

from pydantic import BaseModel, ConfigDict


class InputModel(BaseModel):
    """Base of everything that a user types: immutable; unknown keys and other types are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)
