"""Long tests: hours of faults, and of hostile boards, web clients and Zenoh peers."""
