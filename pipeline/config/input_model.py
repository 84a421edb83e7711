"""The base of everything that a user types."""

from typing import Annotated

from pydantic import AfterValidator, BaseModel, ConfigDict, Field

from hbm.spelling import printable

Text = Annotated[str, Field(min_length=1), AfterValidator(printable)]


class InputModel(BaseModel):
    """Base of everything that a user types: immutable; unknown keys and other types are refused."""

    model_config = ConfigDict(extra="forbid", frozen=True, strict=True, allow_inf_nan=False)
