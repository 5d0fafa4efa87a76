"""What the servers of pages share (view, study, gateway): who may come in, how often, and how long they serve."""
