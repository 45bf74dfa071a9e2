//! How much force a set of contacts can resist: a fast bound for every candidate and an exact cone program for the best.
//!
//! A contact is a point with Coulomb friction whose normal force lies in `[0, cap]`, the cap being what the finger's joint
//! torque can press with. The margin is `min over +-x, +-y, +-z of lambda / (m g)`, `lambda` being the largest force through
//! the centre of mass that the contacts balance without any net torque.

use clarabel::algebra::CscMatrix;
use clarabel::solver::{
    DefaultSettingsBuilder, DefaultSolver, IPSolver, NonnegativeConeT, SecondOrderConeT, SolverStatus, ZeroConeT,
};
use nalgebra::{Vector3, Vector6};
use rand::{Rng, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sfg_types::{Point, Vector};

/// Standard gravity, m/s2.
const GRAVITY: f64 = 9.81;
/// Length that makes torques comparable with forces in the directions of the bound, metres: half a hand's width.
const TORQUE_SCALE_M: f64 = 0.04;
/// Fixed directions of the bound; more barely move it (the descent does the rest).
const N_DIRECTIONS: usize = 64;
/// Directions that are improved by descent.
const N_REFINED: usize = 4;
/// Descent steps for each.
const N_DESCENT_STEPS: usize = 12;

/// Where the hand presses on the object.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Contact {
    /// Point on the surface, base frame, metres.
    pub point_in_base: Point,
    /// Unit normal into the object, base frame.
    pub inward_normal: Vector,
    /// Largest normal force, newtons.
    pub cap_newtons: f64,
}

/// A contact with its friction frame and the arm of its torque about the centre of mass.
struct Prepared {
    normal: Vector,
    tangents: [Vector; 2],
    arm_m: Vector,
    cap_newtons: f64,
}

/// The load that a grasp must bear.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Load {
    /// Where the external force acts, base frame.
    pub centre_of_mass_in_base: Point,
    /// Assumed mass, kilograms.
    pub mass_kg: f64,
    /// Coulomb friction coefficient.
    pub friction: f64,
}

/// Bounds the wrench margin from above without solving a program.
///
/// The wrenches that the contacts can produce are a convex body with the closed-form support function
/// `h(u) = sum cap * max(0, u.w_n + mu |u.w_t|)`; the margin is `min over u of h(u) / (m g |u_force|_inf)`.
/// The minimum is taken over fixed directions and then by subgradient descent from the best of them.
#[derive(Clone, Debug)]
pub struct MarginBound {
    directions: Vec<Vector6<f64>>,
}

impl MarginBound {
    /// A bound whose fixed directions come from `seed`.
    #[must_use]
    pub fn new(seed: u64) -> Self {
        let mut rng = ChaCha8Rng::seed_from_u64(seed);
        let mut directions = Vec::with_capacity(N_DIRECTIONS);
        // Both signs of each direction and its image in y: the bound of a mirrored grasp is then the same number.
        while directions.len() < N_DIRECTIONS {
            let u = Vector6::from_fn(|_, _| rng.random_range(-1.0..1.0_f64));
            if !(0.1..1.0).contains(&u.norm()) {
                continue;
            }
            let u = u.normalize();
            let mirrored = Vector6::new(u[0], -u[1], u[2], -u[3], u[4], -u[5]);
            directions.extend([u, mirrored, -u, -mirrored]);
        }
        Self { directions }
    }

    /// An upper bound of [`wrench_margin`]; zero when some direction cannot be resisted at all.
    #[must_use]
    pub fn evaluate(&self, contacts: &[Contact], load: &Load) -> f64 {
        let prepared = prepare(contacts, load);
        let mut best: [(f64, Vector6<f64>); N_REFINED] = [(f64::INFINITY, Vector6::zeros()); N_REFINED];
        for u in &self.directions {
            let value = ratio(&prepared, load.friction, u).0;
            if value < best[N_REFINED - 1].0 {
                best[N_REFINED - 1] = (value, *u);
                best.sort_by(|a, b| a.0.total_cmp(&b.0));
            }
        }
        let mut lowest = best[0].0;
        for (_, start) in best {
            lowest = lowest.min(descend(&prepared, load.friction, start));
            if lowest <= 0.0 {
                return 0.0;
            }
        }
        lowest / (load.mass_kg * GRAVITY)
    }
}

/// Exact wrench margin over the six force directions, by one second-order cone program each. Zero without force closure.
///
/// # Source
/// The program of the project's simulation notes: friction cones as they are, one cap on each normal force.
#[must_use]
pub fn wrench_margin(contacts: &[Contact], load: &Load) -> f64 {
    if contacts.len() < 2 {
        return 0.0;
    }
    let prepared = prepare(contacts, load);
    let mut margin = f64::INFINITY;
    for axis in 0..3 {
        for sign in [1.0, -1.0] {
            let mut direction = Vector::zeros();
            direction[axis] = sign;
            margin = margin.min(largest_force(&prepared, load.friction, &direction));
            if margin <= 1e-4 {
                return 0.0;
            }
        }
    }
    margin / (load.mass_kg * GRAVITY)
}

fn prepare(contacts: &[Contact], load: &Load) -> Vec<Prepared> {
    contacts
        .iter()
        .map(|contact| {
            let normal = contact.inward_normal;
            let helper = if normal.x.abs() < 0.7 { Vector3::x() } else { Vector3::y() };
            let first = normal.cross(&helper).normalize();
            Prepared {
                normal,
                tangents: [first, normal.cross(&first)],
                arm_m: contact.point_in_base - load.centre_of_mass_in_base,
                cap_newtons: contact.cap_newtons,
            }
        })
        .collect()
}

/// `h(u) / |u_force|_inf` in newtons and the wrench that attains `h(u)`; torques are in units of [`TORQUE_SCALE_M`].
fn ratio(contacts: &[Prepared], friction: f64, u: &Vector6<f64>) -> (f64, Vector6<f64>) {
    let (force_part, torque_part) = (Vector::new(u[0], u[1], u[2]), Vector::new(u[3], u[4], u[5]));
    let mut support = 0.0;
    let mut wrench = Vector6::zeros();
    for contact in contacts {
        // Virtual displacement of the contact point under the twist `u`.
        let v = force_part + torque_part.cross(&contact.arm_m) / TORQUE_SCALE_M;
        let along = v.dot(&contact.normal);
        let across = v - contact.normal * along;
        let across_norm = across.norm();
        let reach = along + friction * across_norm;
        if reach <= 0.0 {
            continue;
        }
        support += contact.cap_newtons * reach;
        let tangential = if across_norm > 1e-12 { across * (friction / across_norm) } else { Vector::zeros() };
        let force = (contact.normal + tangential) * contact.cap_newtons;
        let torque = contact.arm_m.cross(&force) / TORQUE_SCALE_M;
        wrench += Vector6::new(force.x, force.y, force.z, torque.x, torque.y, torque.z);
    }
    let scale = force_part.amax();
    if scale < 0.05 { (f64::INFINITY, wrench) } else { (support / scale, wrench) }
}

fn descend(contacts: &[Prepared], friction: f64, start: Vector6<f64>) -> f64 {
    let mut u = start;
    let mut lowest = f64::INFINITY;
    let mut step = 0.35;
    for _ in 0..N_DESCENT_STEPS {
        let (value, wrench) = ratio(contacts, friction, &u);
        lowest = lowest.min(value);
        let along_sphere = wrench - u * wrench.dot(&u);
        let norm = along_sphere.norm();
        if norm < 1e-9 || !value.is_finite() {
            break;
        }
        u = (u - along_sphere * (step / norm)).normalize();
        step *= 0.75;
    }
    lowest
}

/// Largest `lambda` such that contact forces balance the force `lambda * direction` at the centre of mass.
fn largest_force(contacts: &[Prepared], friction: f64, direction: &Vector) -> f64 {
    let n = contacts.len();
    let n_variables = 3 * n + 1;
    let (mut rows, mut columns, mut values) = (Vec::new(), Vec::new(), Vec::new());
    let mut push = |row: usize, column: usize, value: f64| {
        if value != 0.0 {
            rows.push(row);
            columns.push(column);
            values.push(value);
        }
    };
    // Balance of force and torque; forces are measured in units of each contact's cap to keep the program well scaled.
    for (i, contact) in contacts.iter().enumerate() {
        for (k, axis) in [contact.normal, contact.tangents[0], contact.tangents[1]].into_iter().enumerate() {
            let force = axis * contact.cap_newtons;
            let torque = contact.arm_m.cross(&force) / TORQUE_SCALE_M;
            for d in 0..3 {
                push(d, 3 * i + k, force[d]);
                push(3 + d, 3 * i + k, torque[d]);
            }
        }
    }
    for d in 0..3 {
        push(d, 3 * n, direction[d]);
    }
    let mut b = vec![0.0; 6];
    // Caps: 1 - f_n >= 0.
    for i in 0..n {
        push(6 + i, 3 * i, 1.0);
        b.push(1.0);
    }
    // Cones: (mu f_n, f_t1, f_t2).
    for i in 0..n {
        let row = 6 + n + 3 * i;
        push(row, 3 * i, -friction);
        push(row + 1, 3 * i + 1, -1.0);
        push(row + 2, 3 * i + 2, -1.0);
        b.extend([0.0; 3]);
    }
    let mut cones = vec![ZeroConeT(6), NonnegativeConeT(n)];
    cones.extend((0..n).map(|_| SecondOrderConeT(3)));
    let constraints = CscMatrix::new_from_triplets(b.len(), n_variables, rows, columns, values);
    let mut cost = vec![0.0; n_variables];
    cost[3 * n] = -1.0;
    let settings = DefaultSettingsBuilder::default()
        .verbose(false)
        .presolve_enable(false)
        .equilibrate_enable(false)
        .tol_gap_abs(1e-3)
        .tol_gap_rel(1e-3)
        .tol_feas(1e-5)
        .max_iter(40)
        .build();
    let Ok(settings) = settings else { return 0.0 };
    let zero = CscMatrix::zeros((n_variables, n_variables));
    let Ok(mut solver) = DefaultSolver::new(&zero, &cost, &constraints, &b, &cones, settings) else { return 0.0 };
    solver.solve();
    match solver.solution.status {
        SolverStatus::Solved | SolverStatus::AlmostSolved => solver.solution.x[3 * n].max(0.0),
        // Without a trustworthy answer the grasp counts as one that resists nothing.
        _ => 0.0,
    }
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    use super::*;

    const LOAD: Load = Load { centre_of_mass_in_base: Point::new(0.6, 0.1, 0.8), mass_kg: 1.0 / GRAVITY, friction: 0.5 };

    fn contact(arm: [f64; 3]) -> Contact {
        let arm = Vector::from(arm);
        Contact { point_in_base: LOAD.centre_of_mass_in_base + arm * 0.03, inward_normal: -arm.normalize(), cap_newtons: 10.0 }
    }

    #[track_caller]
    fn check(arms: &[[f64; 3]], expected: f64) {
        let contacts: Vec<_> = arms.iter().map(|&arm| contact(arm)).collect();
        let exact = wrench_margin(&contacts, &LOAD);
        let bound = MarginBound::new(3).evaluate(&contacts, &LOAD);
        assert!((exact - expected).abs() < 0.02 * expected.max(1.0), "margin {exact}, expected {expected}");
        assert!(bound >= exact - 0.02 * expected.max(1.0), "bound {bound} is below the margin {exact}");
        assert!(bound <= 3.0 * exact + 1.0, "bound {bound} is far above the margin {exact}");
    }

    #[test]
    fn two_opposed_points_resist_by_friction_alone() {
        // Across the line of contact: 2 * mu * cap = 10; along it: one cap less nothing = 10.
        check(&[[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0]], 10.0);
    }

    #[test]
    fn two_points_on_one_side_resist_nothing() {
        check(&[[1.0, 0.2, 0.0], [1.0, -0.2, 0.0]], 0.0);
    }

    #[test]
    fn one_point_resists_nothing() {
        check(&[[1.0, 0.0, 0.0]], 0.0);
    }

    #[test]
    fn the_bound_is_symmetric_under_mirroring() {
        let arms = [[1.0, 0.3, 0.1], [-0.8, 0.5, 0.0], [-0.2, -1.0, 0.4]];
        let bound = MarginBound::new(7);
        let load = Load { centre_of_mass_in_base: Point::new(0.6, 0.0, 0.8), ..LOAD };
        let of = |flip: f64| {
            let contacts: Vec<_> = arms
                .iter()
                .map(|a| {
                    let arm = Vector::new(a[0], a[1] * flip, a[2]);
                    Contact {
                        point_in_base: load.centre_of_mass_in_base + arm * 0.03,
                        inward_normal: -arm.normalize(),
                        cap_newtons: 8.0,
                    }
                })
                .collect();
            bound.evaluate(&contacts, &load)
        };
        assert!((of(1.0) - of(-1.0)).abs() < 1e-9);
    }
}
