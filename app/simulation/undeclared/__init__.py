"""Simulated machines and measurement campaigns with an effect in them that nobody declared.

They judge the search for effects that the thermal model lacks, and their worth is their
independence: nothing here imports anything else of the package. Geometry, interpolation and
signs are written again from their definitions, so that a mistake on one side shows on the other;
`tests/test_architecture.py` holds that.

    from app.simulation.undeclared import make_campaign

    campaign = make_campaign(3, "thermal-lag", amplitude=2.0)
    campaign.machine, campaign.error_maps, campaign.reading_bodies, campaign.verifications
    campaign.truth.effects, campaign.truth.contribution_um
    campaign.oracle(campaign.every_fourth_visit())

    record = make_record(4, "thermal-lag", hours=30, wander_um=1.0, later_visits=10)
    record.as_one_verification(), record.as_many_verifications(every_min=120)
    record.later.error_um(), record.later.left_um(correction_um)

`thermap simulate campaign --help` writes the same as files; README.md beside this file says what
is simulated and how.
"""

from app.simulation.undeclared.campaign import Campaign, make_campaign, make_record
from app.simulation.undeclared.planted import FAMILIES
from app.simulation.undeclared.planting import ALL
from app.simulation.undeclared.unknown import UNKNOWN

__all__ = ["ALL", "FAMILIES", "UNKNOWN", "Campaign", "make_campaign", "make_record"]
