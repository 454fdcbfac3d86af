"""One public function per step of an alignment, in the order of the paper."""
