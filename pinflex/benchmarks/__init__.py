"""What pinflex is measured by: published cases, work and precision, the race."""
