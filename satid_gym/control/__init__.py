"""Body-rate control: the rate loop that turns rate commands into wheel torque, and forecasts of what they teach."""
