"""Long proofs: hours of faults and of hostile peers."""
