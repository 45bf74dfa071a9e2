//! Simulated scene: arm and hand multibody, objects, grains, cameras and the judge.
