//! The small quadratic program, and the safety filter at 1 kHz with 7 and 14 joints: per-item times over seeded inputs.
//!
//! `cargo bench -p sfg-planning --bench safety`. The program is also solved by clarabel at tight tolerance, in the same run.
#![allow(clippy::unwrap_used, clippy::print_stdout, reason = "a measuring program")]

use clarabel::algebra::CscMatrix;
use clarabel::solver::{DefaultSettingsBuilder, DefaultSolver, IPSolver as _, NonnegativeConeT};
use nalgebra::{DMatrix, DVector, Vector3};
use rand::{Rng as _, SeedableRng};
use rand_chacha::ChaCha8Rng;
use sfg_kinematics::ik::random_q;
use sfg_kinematics::{RobotModel, Shape};
use sfg_planning::{CollisionModel, CollisionSettings, FilterSettings, Obstacle, QuadraticProgram, SafetyFilter, solve_qp};
use sfg_types::Pose;
use std::path::Path;
use std::time::Instant;

fn main() {
    programs(7, 30);
    programs(14, 50);
    let path = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../scenarios/robots/curi.yaml");
    let model = RobotModel::load(&path).unwrap();
    for name in ["left", "both"] {
        for (what, amplitude_rad) in [("calm", 0.15), ("hostile", 1.5)] {
            filter(&model, name, what, amplitude_rad);
        }
    }
}

fn print(name: &str, mut micros: Vec<f64>) {
    micros.sort_by(f64::total_cmp);
    let at = |share: f64| micros[(share * (micros.len() - 1) as f64) as usize];
    println!(
        "{name:<28} n {:>6}  median {:>7.2} us  p95 {:>7.2}  p99 {:>7.2}  longest {:>8.2}",
        micros.len(),
        at(0.5),
        at(0.95),
        at(0.99),
        at(1.0)
    );
}

/// Velocity programs: a task's Jacobian, a box, and rows of distances.
fn programs(n: usize, m: usize) {
    let mut rng = ChaCha8Rng::seed_from_u64(0);
    let (mut ours, mut theirs, mut n_active, mut largest) = (Vec::new(), Vec::new(), 0, 0.0_f64);
    for _ in 0..1000 {
        let jacobian = DMatrix::from_fn(6, n, |_, _| rng.random_range(-1.0..1.0));
        let wanted = DVector::from_fn(6, |_, _| rng.random_range(-1.0..1.0));
        let rows = DMatrix::from_fn(m, n, |row, column| match row {
            row if row < n => f64::from(u8::from(row == column)),
            row if row < 2 * n => -f64::from(u8::from(row - n == column)),
            _ => rng.random_range(-1.0..1.0),
        });
        let program = QuadraticProgram {
            hessian: jacobian.transpose() * &jacobian + DMatrix::identity(n, n) * 1e-2,
            gradient: -(jacobian.transpose() * wanted),
            rows,
            bounds: DVector::from_fn(m, |_, _| rng.random_range(0.02..1.0)),
        };
        let begun = Instant::now();
        let solution = solve_qp(&program).unwrap();
        ours.push(1e6 * begun.elapsed().as_secs_f64());
        n_active += solution.multipliers.iter().filter(|u| **u > 0.0).count();
        let begun = Instant::now();
        let reference = by_clarabel(&program);
        theirs.push(1e6 * begun.elapsed().as_secs_f64());
        // By the value that is reached: where the cost is flat, an interior point is 1e-5 away at the same value.
        let value = |x: &DVector<f64>| 0.5 * x.dot(&(&program.hessian * x)) + program.gradient.dot(x);
        largest = largest.max((value(&solution.x) - value(&reference)).abs());
    }
    print(&format!("qp {n} x {m}"), ours);
    print(&format!("qp {n} x {m}, clarabel"), theirs);
    println!("    {:.1} active rows on average; largest difference of the minimum {largest:.1e}", n_active as f64 / 1000.0);
}

fn by_clarabel(program: &QuadraticProgram) -> DVector<f64> {
    let n = program.gradient.len();
    let sparse = |matrix: &DMatrix<f64>, upper_only: bool| {
        let rows: Vec<Vec<f64>> = (0..matrix.nrows())
            .map(|row| (0..n).map(|column| if !upper_only || row <= column { matrix[(row, column)] } else { 0.0 }).collect())
            .collect();
        CscMatrix::from(&rows)
    };
    let settings =
        DefaultSettingsBuilder::default().verbose(false).tol_gap_abs(1e-12).tol_gap_rel(1e-12).tol_feas(1e-12).build().unwrap();
    let cones = [NonnegativeConeT(program.bounds.len())];
    let (p, a) = (sparse(&program.hessian, true), sparse(&program.rows, false));
    let mut solver =
        DefaultSolver::new(&p, program.gradient.as_slice(), &a, program.bounds.as_slice(), &cones, settings).unwrap();
    solver.solve();
    DVector::from_column_slice(&solver.solution.x)
}

/// Sines of all joints about free configurations over a table with things on it.
fn filter(model: &RobotModel, name: &str, what: &str, amplitude_rad: f64) {
    let group = model.group(name).unwrap();
    let settings = CollisionSettings { clearance_m: 0.0, self_clearance_m: 0.0, ..CollisionSettings::default() };
    let mut world = CollisionModel::of_group(model, &group, &model.home_q, settings).unwrap();
    let mut things =
        vec![("table".to_owned(), Shape::Cuboid { half_extents_m: Vector3::new(0.575, 1.2, 0.03) }, [1.025, 0.0, 0.72])];
    for nth in 0..6 {
        let shape = Shape::Cylinder { radius_m: 0.04, half_length_m: 0.12 };
        things.push((format!("thing {nth}"), shape, [0.65 + 0.1 * f64::from(nth % 2), -0.6 + 0.24 * f64::from(nth), 0.87]));
    }
    let obstacles: Vec<Obstacle> = (things.into_iter())
        .map(|(name, shape, [x, y, z])| Obstacle { name, shape, pose_in_base: Pose::translation(x, y, z) })
        .collect();
    world.set_world(&obstacles, None);
    let mut rng = ChaCha8Rng::seed_from_u64(1);
    let n = group.chain.n_joints();
    let (mut micros, mut n_changed) = (Vec::new(), 0);
    for _ in 0..20 {
        let start = loop {
            let q = random_q(&group.chain, &mut rng);
            if world.is_free(&q) {
                break q;
            }
        };
        let mut each = |low: f64, high: f64| (0..n).map(|_| rng.random_range(low..high)).collect::<Vec<f64>>();
        let (amplitude, frequency) = (each(0.2 * amplitude_rad, amplitude_rad), each(1.0, 4.0));
        let mut filter = SafetyFilter::new(group.chain.clone(), &start, 0.001, FilterSettings::default());
        filter.set_world(Some(world.clone()));
        for period in 0..1000 {
            let t = 0.001 * f64::from(period);
            // From rest: 1 - cos.
            let q: Vec<f64> = (0..n).map(|i| start[i] + amplitude[i] * (1.0 - (frequency[i] * t).cos())).collect();
            let dq: Vec<f64> = (0..n).map(|i| amplitude[i] * frequency[i] * (frequency[i] * t).sin()).collect();
            let begun = Instant::now();
            let sent = filter.step(Some((&q, &dq)));
            micros.push(1e6 * begun.elapsed().as_secs_f64());
            n_changed += usize::from(sent.intervention.is_some());
        }
    }
    let share = 100.0 * n_changed as f64 / micros.len() as f64;
    print(&format!("filter, {n} joints, {what}"), micros);
    println!("    {share:.1} % of set points changed");
}
