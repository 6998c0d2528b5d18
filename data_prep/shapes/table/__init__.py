"""Tables and desks. The longer side of the top lies along x; a desk's drawers look to -Z."""
