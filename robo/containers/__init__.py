"""What robo asks of a Docker engine."""
