"""Simulated machines and measurement campaigns with an effect in them that nobody declared.

They test and measure the search for effects that the thermal model lacks, so nothing here
imports the service: the physics is written again from its definitions.

    from benchmarks.undeclared import make_campaign

    campaign = make_campaign(3, "thermal-lag", amplitude=2.0)
    campaign.machine, campaign.error_maps, campaign.reading_bodies, campaign.verifications
    campaign.truth.effects, campaign.truth.contribution_um
    campaign.oracle(campaign.every_nth_visit())

`python -m benchmarks.undeclared --help` writes the same as JSON files; README.md beside this
file says what is simulated and how.
"""

from benchmarks.undeclared.campaign import Campaign, make_campaign
from benchmarks.undeclared.planted import FAMILIES
from benchmarks.undeclared.planting import ALL
from benchmarks.undeclared.unknown import UNKNOWN

__all__ = ["ALL", "FAMILIES", "UNKNOWN", "Campaign", "make_campaign"]
