"""Movies: made from a timelapse, shown over time, and looked at in kymographs and projections."""
