"""What goes wrong on a farm."""

from __future__ import annotations

from fogbank.errors import FogbankError


class FarmError(FogbankError):
    """The farm cannot go on with a job: no worker is fit for it, or the scheduler is gone."""
