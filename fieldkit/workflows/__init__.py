"""A campaign afterwards: its sessions, estimated with whatever parameters, many at a time, once each.

`open_campaign` is the way in from Python; the verbs `estimate` and `sweep` use the same runs.
A room above configuration, sessions and estimation, because it is what needs all three.
"""

from fieldkit.workflows.campaign import Campaign, CampaignSession, open_campaign
from fieldkit.workflows.estimates import Estimates

__all__ = ["Campaign", "CampaignSession", "Estimates", "open_campaign"]
