"""What each actor does, without the actor: plain objects that the local run and the Ray run both use."""
