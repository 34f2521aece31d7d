"""How many streams a mission bears: the real controller and reducer in virtual time, with what they cost here."""
