"""What several experiments share: a world to localize in, the rollouts of Fig. 10, clocks."""
