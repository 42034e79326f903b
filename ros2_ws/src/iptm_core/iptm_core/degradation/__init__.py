"""Laws of capacity loss: what ageing mechanisms have in common, published forms of them, cells."""
