"""A mission in virtual time: models of the actors and links, faults from a seed, and the real controller.

Nothing sleeps and nothing is random but the seed, so that thousands of missions are played in the time of one, and one
that went wrong is played again.
"""
