"""Closed loop among recorded traffic: the stack in the place of each recorded driver."""
