//! Which bodies move with the chain, which must not meet, and all of it compiled for eight configurations at once.

use super::{
    BodyGroup, Cluster, CollisionModel, Fixed, Moving, POINTS, SelfPairs, bound, depth, depth_between, fixed, moving, near,
};
use crate::batch::{Batch, BodySpec};
use crate::error::PlanningError;
use crate::shapes::{bounding_radius_m, covering_spheres};
use rand::SeedableRng;
use rand_chacha::ChaCha8Rng;
use sfg_kinematics::ik::random_q;
use sfg_kinematics::{JointKind, Primitive, Shape, Tree};
use sfg_types::Point;

/// A pair of bodies that touches in this share of all configurations is built so, and no collision.
const BUILT_TOUCHING_SHARE: f64 = 0.9;
/// Balls may stand out of a box by this share of its bounding radius: a torso needs no such fine ones as a forearm.
const BOX_EXCESS_SHARE: f64 = 0.1;

impl CollisionModel {
    /// Rebuilds what follows from `moving`, `own_bodies` and the pairs that are built touching.
    pub(super) fn index(&mut self) {
        // Hands apart from arms: two clusters a link at most.
        let place = |m: &Moving| (m.frame_idx, m.group != BodyGroup::Arm);
        self.moving.sort_by_key(place);
        self.clusters.clear();
        let mut first = 0;
        while first < self.moving.len() {
            let frame_idx = self.moving[first].frame_idx;
            let n = self.moving[first..].iter().take_while(|m| place(m) == place(&self.moving[first])).count();
            let spheres = self.moving[first..first + n].iter().flat_map(|m| &m.spheres);
            self.clusters.push(Cluster { frame_idx, bodies: first..first + n, bound: bound(spheres) });
            first += n;
        }
        let disabled = |a: &str, b: &str| match &self.self_pairs {
            SelfPairs::Sampled => None,
            SelfPairs::AllBut(pairs) => {
                let pair = |a: &str, b: &str| pairs.contains(&(a.to_owned(), b.to_owned()));
                Some(a == b || pair(a, b) || pair(b, a))
            }
        };
        let is_built_on = |body: &Moving, own_idx: usize| self.built_on_own.contains(&(body.name.clone(), own_idx));
        let is_built = |body: &Moving, other: &Moving| self.built_touching.contains(&(body.name.clone(), other.name.clone()));
        self.ignored = self
            .moving
            .iter()
            .map(|body| {
                let own = self.own_bodies.iter().enumerate();
                own.map(|(idx, own)| {
                    disabled(&body.name, &own.name)
                        .unwrap_or_else(|| self.is_trunk(body) || self.is_next_to(body, own) || is_built_on(body, idx))
                })
                .collect()
            })
            .collect();
        self.guarded = self
            .moving
            .iter()
            .enumerate()
            .map(|(idx, body)| {
                let must_not_meet = |other: &Moving| match disabled(&body.name, &other.name) {
                    Some(is_disabled) => !is_disabled,
                    None => self.may_meet(body, other) && !is_built(body, other),
                };
                self.moving[..idx].iter().map(must_not_meet).collect()
            })
            .collect();
        self.compile();
    }

    /// Rebuilds `batch`.
    pub(super) fn compile(&mut self) {
        let mut batch = Batch::new(&self.chain);
        for cluster in &self.clusters {
            let bodies: Vec<BodySpec<'_>> = self.moving[cluster.bodies.clone()]
                .iter()
                .map(|body| BodySpec { balls_in_link: &body.spheres, may_touch_points: self.allows(body.group, POINTS) })
                .collect();
            batch.add_cluster(&self.chain, cluster.frame_idx, &bodies);
        }
        for obstacle in &self.obstacles {
            let may_touch = |idx: usize| self.allows(self.moving[idx].group, &obstacle.name);
            batch.add_still(&obstacle.shape, &obstacle.shape_from_base.inverse(), self.settings.clearance_m, may_touch);
        }
        for (own_idx, own) in self.own_bodies.iter().enumerate() {
            batch.add_still(&own.shape, &own.shape_from_base.inverse(), self.settings.self_clearance_m, |idx| {
                self.ignored[idx][own_idx]
            });
        }
        for (later, cluster) in self.clusters.iter().enumerate() {
            for (earlier, other) in self.clusters[..later].iter().enumerate() {
                let pairs = cluster.bodies.clone().flat_map(|idx| other.bodies.clone().map(move |other_idx| (idx, other_idx)));
                batch.add_meeting((later, earlier), pairs.filter(|(idx, other_idx)| self.guarded[*idx][*other_idx]).collect());
            }
        }
        batch.set_points(self.points.clone(), self.settings.clearance_m);
        batch.set_self_margin(self.settings.self_clearance_m);
        self.batch = batch;
    }

    pub(super) fn place_bodies(&mut self, tree: &Tree, q: &[f64]) -> Result<(), PlanningError> {
        let poses = tree.link_poses(q);
        let carrier = |name: &String| {
            let joint_idx = tree.links.iter().find(|link| link.name == *name)?.joint_idx?;
            Some(tree.links[tree.joints[joint_idx].parent_idx].name.clone())
        };
        self.carriers = self.chain.link_names.iter().map(|name| carrier(name).unwrap_or_default()).collect();
        self.moving.retain(|m| m.group == BodyGroup::Attached);
        let attached = std::mem::take(&mut self.moving);
        self.own_bodies.clear();
        for (link_idx, link) in tree.links.iter().enumerate() {
            if let Some(mesh) =
                link.collision.iter().find_map(|p| if let Shape::Mesh { file, .. } = &p.shape { Some(file) } else { None })
            {
                return Err(PlanningError::MeshShape { link: link.name.clone(), file: mesh.clone() });
            }
            // Climb to the nearest link that a joint of the chain moves.
            let mut at = link_idx;
            let mut is_hand = false;
            let mut n_beyond = 0;
            let carrier = loop {
                if let Some(idx) = self.chain.link_names.iter().position(|name| *name == tree.links[at].name) {
                    break Some(idx);
                }
                if self.hand_roots.contains(&tree.links[at].name) {
                    (is_hand, n_beyond) = (true, 1);
                }
                match tree.links[at].joint_idx {
                    Some(joint_idx) => {
                        n_beyond += usize::from(tree.joints[joint_idx].kind != JointKind::Fixed);
                        at = tree.joints[joint_idx].parent_idx;
                    }
                    None => break None,
                }
            };
            match carrier {
                None => {
                    let bodies =
                        link.collision.iter().map(|p| fixed(link.name.clone(), &p.shape, &(poses[link_idx] * p.link_from_shape)));
                    self.own_bodies.extend(bodies);
                }
                Some(frame_idx) => {
                    let carrier_from_link = poses[at].inverse() * poses[link_idx];
                    let excess = |p: &Primitive| match &p.shape {
                        _ if is_hand => self.settings.hand_excess_m,
                        Shape::Cuboid { .. } => self.settings.arm_excess_m.max(BOX_EXCESS_SHARE * bounding_radius_m(&p.shape)),
                        _ => self.settings.arm_excess_m,
                    };
                    let spheres: Vec<(Point, f64)> = link
                        .collision
                        .iter()
                        .flat_map(|p| covering_spheres(p, excess(p)))
                        .map(|(centre, radius)| (carrier_from_link * centre, radius))
                        .collect();
                    if !spheres.is_empty() {
                        let group = if is_hand { BodyGroup::Hand } else { BodyGroup::Arm };
                        self.moving.push(moving(link.name.clone(), group, frame_idx, n_beyond, spheres));
                    }
                }
            }
        }
        self.moving.extend(attached);
        self.index();
        Ok(())
    }

    /// Whether a body is up to two joints away from the link `own` that carries its branch.
    fn is_next_to(&self, body: &Moving, own: &Fixed) -> bool {
        let way: Vec<usize> = std::iter::successors(Some(body.frame_idx), |idx| self.chain.joint(*idx).parent).collect();
        way.len() + body.n_beyond <= 2 && way.last().is_some_and(|first| self.carriers[*first] == own.name)
    }

    fn is_trunk(&self, body: &Moving) -> bool {
        body.n_beyond == 0 && self.trunk.get(body.frame_idx).is_some_and(|is_trunk| *is_trunk)
    }

    /// Links up to two apart cannot meet within the joints' limits, though their balls may.
    fn may_meet(&self, body: &Moving, other: &Moving) -> bool {
        if body.frame_idx == other.frame_idx || (self.is_trunk(body) && self.is_trunk(other)) {
            return false;
        }
        // Compiled joints from the link to the base.
        let way = |body: &Moving| std::iter::successors(Some(body.frame_idx), |idx| self.chain.joint(*idx).parent).collect();
        let (a, b): (Vec<usize>, Vec<usize>) = (way(body), way(other));
        let n_shared = a.iter().rev().zip(b.iter().rev()).take_while(|(a, b)| a == b).count();
        a.len() + b.len() - 2 * n_shared + body.n_beyond + other.n_beyond > 2
    }

    /// Samples configurations to find pairs that touch nearly always.
    pub(super) fn find_built_contacts(&mut self) {
        let mut rng = ChaCha8Rng::seed_from_u64(0);
        let n_samples = 300;
        let n = self.moving.len();
        let mut on_own = vec![vec![0_usize; self.own_bodies.len()]; n];
        let mut with_other = vec![vec![0_usize; n]; n];
        let may_meet: Vec<Vec<usize>> =
            (0..n).map(|idx| (0..idx).filter(|other| self.may_meet(&self.moving[idx], &self.moving[*other])).collect()).collect();
        for _ in 0..n_samples {
            let frames = self.chain.fk_all(&random_q(&self.chain, &mut rng));
            let centres: Vec<Point> = self.moving.iter().map(|body| frames[body.frame_idx] * body.bound.0).collect();
            for (idx, body) in self.moving.iter().enumerate() {
                let to_base = &frames[body.frame_idx];
                for (own, count) in self.own_bodies.iter().zip(&mut on_own[idx]) {
                    *count += usize::from(near(&centres[idx], body.bound.1, own) && depth(body, to_base, own) > 0.0);
                }
                for &other_idx in &may_meet[idx] {
                    let other = &self.moving[other_idx];
                    let touches = (centres[idx] - centres[other_idx]).norm() < body.bound.1 + other.bound.1
                        && depth_between(body, to_base, other, &frames[other.frame_idx]) > 0.0;
                    with_other[idx][other_idx] += usize::from(touches);
                }
            }
        }
        let least = (BUILT_TOUCHING_SHARE * f64::from(n_samples)) as usize;
        let often =
            |counts: &[usize]| counts.iter().enumerate().filter(|(_, n)| **n >= least).map(|(idx, _)| idx).collect::<Vec<_>>();
        for (idx, body) in self.moving.iter().enumerate() {
            self.built_on_own.extend(often(&on_own[idx]).into_iter().map(|own_idx| (body.name.clone(), own_idx)));
            let others = often(&with_other[idx]).into_iter().map(|other| (body.name.clone(), self.moving[other].name.clone()));
            self.built_touching.extend(others);
        }
        self.index();
    }
}
