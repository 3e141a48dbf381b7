"""Which entries of the list may come next: offers in, those out with which no long way is wasted. Pure."""

from __future__ import annotations

from collections.abc import Sequence

from onboard.planner.exploration.frontiers import SMALL_M, FrontierGroup
from onboard.planner.exploration.queries import Offer

FAR_FOR_SMALL_M = 8.0  # of a detour: not worth it for a small entry
SLACK_M = 2.0  # a tour so much longer is as good: what lies beyond the entries is not known anyway

Offers = Sequence[tuple[FrontierGroup, Offer]]


def worthwhile(offers: Offers) -> list[FrontierGroup]:
    """The entries that a tour home past all of them may begin with, the nearest first."""
    offers = [(group, offer) for group, offer in offers if not too_far(group, offer)]
    least_m = min((offer.tour_m for _, offer in offers), default=0.0)
    return [group for group, offer in offers if offer.tour_m <= least_m + SLACK_M]


def too_far(group: FrontierGroup, offer: Offer) -> bool:
    """Is so little to be seen there that the way to it is not worth it?"""
    return group.width_m < SMALL_M and offer.detour_m > FAR_FOR_SMALL_M
