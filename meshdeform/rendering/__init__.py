"""Draw meshes: in numpy for people and the judge, and differentiably, with torch, for what guides by pictures."""
