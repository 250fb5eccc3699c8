"""Long tests: hours of faults, and of hostile boards, clients and peers."""
