//! Hand profiles: synergy matrix, joint order, grasp types to synergy coordinates.
