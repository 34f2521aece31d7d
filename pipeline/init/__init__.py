"""From a folder of files to a mission that can be run: what is there, what belongs together, what was assumed."""
