//! The physical scene: which body is what.

use crate::convert::{from_physics, point_from_physics};
use crate::judge::Finger;
use rapier3d::prelude::*;
use sfg_geometry::{ObjectInstance, Touches};
use sfg_types::{Point, Vector as Vector64};

/// What a collider belongs to; kept in the collider's user data.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Role {
    /// Table.
    Table,
    /// Any robot link but the acting hand.
    Robot,
    /// The acting hand; index into [`Bodies::hand`].
    Hand(usize),
    /// An object; index into [`Bodies::objects`], index of the piece.
    Object(usize, usize),
    /// A grain; index into [`Bodies::grains`].
    Grain(usize),
}

impl Role {
    pub(crate) fn encode(self) -> u128 {
        let pack = |tag: u128, a: usize, b: usize| tag | (a as u128) << 8 | (b as u128) << 64;
        match self {
            Self::Robot => pack(0, 0, 0),
            Self::Table => pack(1, 0, 0),
            Self::Hand(link_idx) => pack(2, link_idx, 0),
            Self::Object(object_idx, piece_idx) => pack(3, object_idx, piece_idx),
            Self::Grain(grain_idx) => pack(4, grain_idx, 0),
        }
    }

    pub(crate) fn decode(data: u128) -> Self {
        let a = (data >> 8) as usize & 0xffff_ffff;
        match data & 0xff {
            1 => Self::Table,
            2 => Self::Hand(a),
            3 => Self::Object(a, (data >> 64) as usize),
            4 => Self::Grain(a),
            _ => Self::Robot,
        }
    }
}

/// An object of the scene.
#[derive(Debug)]
pub(crate) struct ObjectBody {
    pub(crate) name: String,
    pub(crate) body: RigidBodyHandle,
    /// One collider for each collision piece, with the label of its part.
    pub(crate) pieces: Vec<(ColliderHandle, String)>,
    pub(crate) instance: ObjectInstance,
    pub(crate) colour: Option<[u8; 3]>,
    pub(crate) mass_range_kg: [f64; 2],
}

impl ObjectBody {
    /// The pieces that hands, the table and other objects can touch: all but the walls that a bored scan has for grains alone.
    pub(crate) fn tangible_pieces(&self) -> impl Iterator<Item = &(ColliderHandle, String)> {
        let models = self.instance.pieces.iter();
        self.pieces.iter().zip(models).filter(|(_, model)| model.touches != Touches::GrainsOnly).map(|(piece, _)| piece)
    }
}

/// A grain.
#[derive(Clone, Copy, Debug)]
pub(crate) struct GrainBody {
    pub(crate) body: RigidBodyHandle,
    /// The vessel it began in.
    pub(crate) vessel_idx: usize,
}

/// A link of the acting hand.
#[derive(Clone, Debug)]
pub(crate) struct HandLink {
    pub(crate) name: String,
    pub(crate) finger: Finger,
    /// The last link of its finger.
    pub(crate) is_tip: bool,
    pub(crate) body: RigidBodyHandle,
    pub(crate) colliders: Vec<ColliderHandle>,
}

/// Everything that moves or is touched.
pub(crate) struct Bodies {
    pub(crate) physics: PhysicsWorld,
    pub(crate) table_height_m: f64,
    pub(crate) objects: Vec<ObjectBody>,
    pub(crate) grains: Vec<GrainBody>,
    pub(crate) hand: Vec<HandLink>,
}

impl Bodies {
    pub(crate) fn pose(&self, body: RigidBodyHandle) -> sfg_types::Pose {
        from_physics(self.physics.bodies[body].position())
    }

    pub(crate) fn centre(&self, body: RigidBodyHandle) -> Point {
        point_from_physics(self.physics.bodies[body].center_of_mass())
    }

    /// Velocity of the point of `body` that is now at `at`, m/s.
    pub(crate) fn velocity_at(&self, body: RigidBodyHandle, at: &Point) -> Vector64 {
        let at = crate::convert::vector_to_physics(&at.coords);
        crate::convert::vector_from_physics(self.physics.bodies[body].velocity_at_point(at))
    }

    /// Roles of everything that touches object `object_idx` now (contacts within the solver's reach), with the contact impulse of
    /// the last step, Ns.
    pub(crate) fn touching(&self, object_idx: usize) -> impl Iterator<Item = (Role, f32)> + '_ {
        self.contact_pairs(object_idx).map(|(role, pair)| (role, pair.total_impulse_magnitude()))
    }

    /// The same without grains, with the middle of the points that press, weighted with their impulses; of all points where none
    /// presses.
    pub(crate) fn contacts(&self, object_idx: usize) -> impl Iterator<Item = (Role, f32, Point)> + '_ {
        self.contact_pairs(object_idx).filter(|(role, _)| !matches!(role, Role::Grain(_))).map(|(role, pair)| {
            let place = *self.physics.colliders[pair.collider1].position();
            let points: Vec<(Point, f64)> = pair
                .manifolds()
                .iter()
                .flat_map(|manifold| {
                    let from_shape = manifold.subshape_pos1().map_or(place, |shape| place * *shape);
                    manifold
                        .points
                        .iter()
                        .map(move |point| (point_from_physics(from_shape * point.local_p1), f64::from(point.data.impulse)))
                })
                .collect();
            let pressing: f64 = points.iter().map(|(_, impulse)| impulse).sum();
            let weight = |impulse: f64| if pressing > 0.0 { impulse / pressing } else { 1.0 / points.len() as f64 };
            let middle: Vector64 = points.iter().map(|(point, impulse)| point.coords * weight(*impulse)).sum();
            (role, pair.total_impulse_magnitude(), middle.into())
        })
    }

    fn contact_pairs(&self, object_idx: usize) -> impl Iterator<Item = (Role, &ContactPair)> + '_ {
        let physics = &self.physics;
        self.objects[object_idx].pieces.iter().flat_map(move |(collider, _)| {
            physics.narrow_phase.contact_pairs_with(*collider).filter(|pair| pair.has_any_active_contact()).map(move |pair| {
                let other = if pair.collider1 == *collider { pair.collider2 } else { pair.collider1 };
                (Role::decode(physics.colliders[other].user_data), pair)
            })
        })
    }

    /// What lies deepest inside object `object_idx`, other than table and grains, and how deep, metres.
    pub(crate) fn deepest_overlap(&self, object_idx: usize) -> Option<(Role, f64)> {
        let physics = &self.physics;
        let pairs = self.objects[object_idx].pieces.iter().flat_map(|(collider, _)| {
            physics.narrow_phase.contact_pairs_with(*collider).map(move |pair| {
                let other = if pair.collider1 == *collider { pair.collider2 } else { pair.collider1 };
                let distances = pair.manifolds().iter().flat_map(|manifold| manifold.points.iter().map(|point| point.dist));
                (Role::decode(physics.colliders[other].user_data), -f64::from(distances.fold(0.0, f32::min)))
            })
        });
        let solid = pairs.filter(|(role, depth_m)| !matches!(role, Role::Table | Role::Grain(_)) && *depth_m > 0.0);
        solid.max_by(|a, b| a.1.total_cmp(&b.1))
    }

    /// Height of the lowest point of an object above the table top, metres.
    pub(crate) fn clearance_m(&self, object_idx: usize) -> f64 {
        let lowest = self.objects[object_idx]
            .tangible_pieces()
            .map(|(collider, _)| self.physics.colliders[*collider].compute_aabb().mins.z)
            .fold(f32::INFINITY, f32::min);
        f64::from(lowest) - self.table_height_m
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn roles_survive_user_data() {
        for role in [Role::Table, Role::Robot, Role::Hand(19), Role::Object(7, 300), Role::Grain(149)] {
            assert_eq!(Role::decode(role.encode()), role);
        }
    }
}
