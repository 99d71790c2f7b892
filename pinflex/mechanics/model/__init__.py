"""What a mechanism is made of: links, beams, joints, loads."""
