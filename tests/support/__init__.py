"""What tests of several folders share: substitutes, streams of frames, boards and pages."""
