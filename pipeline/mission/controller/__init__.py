"""The running mission as a pure state machine: ``step(state, event, now) -> (state, orders)``.

Reports of the actors, answers of the solver and the operator's wishes come in as events; what each actor should do
goes out as orders. An order states the *whole* of what its actor should do and is given again until a report says
that it is so: an order or a report that is lost costs time, and nothing else. No thread, no socket, no clock, no Ray.
"""
