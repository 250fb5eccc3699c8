"""What touches a strip: a person, a typist, a stage, a linkage."""
