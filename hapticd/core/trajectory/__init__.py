"""Reference polylines: how many knots a frame needs, and the gate that every reference passes."""
