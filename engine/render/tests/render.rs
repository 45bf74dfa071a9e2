//! Rendered depth, identities and colours against analytic rays; noise against its specification.
#![allow(clippy::unwrap_used, reason = "tests fail by panicking")]

use nalgebra::{Point3, UnitQuaternion, Vector3};
use sfg_geometry::mesh;
use sfg_render::{Frame, Item, NO_ID, RenderMesh, Scene, SensorNoise, Sphere, camera, render};
use sfg_types::{CameraIntrinsics, Pose};

const LENS: CameraIntrinsics = CameraIntrinsics { width: 160, height: 120, fx: 120.0, fy: 125.0, cx: 80.3, cy: 59.1 };

fn view() -> Pose {
    camera::look_at(&Point3::new(0.1, 0.3, 1.3), &Point3::new(0.65, 0.0, 0.85))
}

fn item(mesh: &RenderMesh, base_from_mesh: Pose, instance_id: u16) -> Item<'_> {
    Item { mesh, base_from_mesh, colour: [200, 100, 50], finish: Default::default(), instance_id, part_id: instance_id + 10 }
}

/// Depth where the ray of a pixel meets a solid first: `enter` gives the ray parameter from origin and direction in the solid's frame.
fn check_depth(frame: &Frame, base_from_solid: &Pose, enter: impl Fn(&Point3<f64>, &Vector3<f64>) -> Option<f64>) -> usize {
    let solid_from_camera = base_from_solid.inverse() * view();
    let origin = Point3::from(solid_from_camera.translation.vector);
    let mut n_hit = 0;
    let mut n_edge = 0;
    for row in 0..LENS.height {
        for column in 0..LENS.width {
            let ray = LENS.deproject(column as f64, row as f64, 1.0).coords;
            let expected = enter(&origin, &(solid_from_camera.rotation * ray));
            let depth = f64::from(frame.depth_m[row * LENS.width + column]);
            match expected {
                Some(exact) if depth > 0.0 => {
                    n_hit += 1;
                    assert!((depth - exact).abs() < 1e-4, "pixel ({column}, {row}): {depth} m instead of {exact} m");
                }
                None if depth == 0.0 => {}
                // A ray that grazes an edge may go either way.
                _ => n_edge += 1,
            }
        }
    }
    assert!(n_edge <= 2, "{n_edge} pixels differ in hit or miss");
    n_hit
}

fn enter_box(half: Vector3<f64>) -> impl Fn(&Point3<f64>, &Vector3<f64>) -> Option<f64> {
    move |origin, direction| {
        let (mut first, mut last) = (0.0_f64, f64::INFINITY);
        for axis in 0..3 {
            let (a, b) = ((-half[axis] - origin[axis]) / direction[axis], (half[axis] - origin[axis]) / direction[axis]);
            first = first.max(a.min(b));
            last = last.min(a.max(b));
        }
        (first <= last).then_some(first)
    }
}

fn enter_ball(radius: f64) -> impl Fn(&Point3<f64>, &Vector3<f64>) -> Option<f64> {
    move |origin, direction| {
        let (a, b) = (direction.norm_squared(), direction.dot(&origin.coords));
        let root = b * b - a * (origin.coords.norm_squared() - radius * radius);
        (root >= 0.0).then(|| (-b - root.sqrt()) / a)
    }
}

#[test]
fn a_box_has_the_depth_of_its_rays() {
    let half = Vector3::new(0.05, 0.09, 0.12);
    let mesh = RenderMesh::new(&mesh::cuboid(&half));
    let pose = Pose::from_parts(Vector3::new(0.65, 0.0, 0.87).into(), UnitQuaternion::from_euler_angles(0.3, -0.2, 0.9));
    let scene = Scene { items: vec![item(&mesh, pose, 3)], ..Scene::default() };
    let frame = render(&scene, &LENS, &view());
    let n_hit = check_depth(&frame, &pose, enter_box(half));
    assert!(n_hit > 300, "{n_hit} pixels");
    assert_eq!(frame.mask_of(3, None).iter().filter(|&&m| m == 1).count(), n_hit);
    assert_eq!(frame.mask_of(3, Some(13)), frame.mask_of(3, None));
    assert!(frame.mask_of(3, Some(3)).iter().all(|&m| m == 0));
}

#[test]
fn a_ball_has_the_depth_of_its_rays() {
    let pose = Pose::translation(0.65, 0.05, 0.87);
    let sphere =
        Sphere { centre_in_base: Point3::new(0.65, 0.05, 0.87), radius_m: 0.08, colour: [90; 3], instance_id: 5, part_id: 6 };
    let frame = render(&Scene { spheres: vec![sphere], ..Scene::default() }, &LENS, &view());
    assert!(check_depth(&frame, &pose, enter_ball(0.08)) > 300);
    assert!(frame.instance_ids.iter().zip(&frame.depth_m).all(|(&id, &d)| id == if d > 0.0 { 5 } else { NO_ID }));
}

#[test]
fn a_table_reaching_behind_the_camera_is_cut_and_stays_exact() {
    let half = Vector3::new(3.0, 3.0, 0.02);
    let mesh = RenderMesh::new(&mesh::cuboid(&half));
    let pose = Pose::translation(0.6, 0.0, 0.73);
    let frame = render(&Scene { items: vec![item(&mesh, pose, 1)], ..Scene::default() }, &LENS, &view());
    assert!(check_depth(&frame, &pose, enter_box(half)) > 10_000);
}

#[test]
fn the_nearer_surface_wins_whatever_the_order() {
    let (near, far) = (Pose::translation(0.55, 0.05, 0.93), Pose::translation(0.75, -0.05, 0.77));
    let mesh = RenderMesh::new(&mesh::sphere(0.06, 32));
    let draw = |poses: [(Pose, u16); 2]| {
        let items = poses.map(|(pose, id)| item(&mesh, pose, id)).to_vec();
        render(&Scene { items, ..Scene::default() }, &LENS, &view())
    };
    let (a, b) = (draw([(near, 1), (far, 2)]), draw([(far, 2), (near, 1)]));
    assert_eq!(a, b);
    let (n_near, n_far) = (a.mask_of(1, None), a.mask_of(2, None));
    let count = |mask: &[u8]| mask.iter().filter(|&&m| m == 1).count();
    let alone = render(&Scene { items: vec![item(&mesh, far, 2)], ..Scene::default() }, &LENS, &view());
    assert!(count(&n_near) > 100 && count(&n_far) < count(&alone.mask_of(2, None)), "the far ball is partly hidden");
}

#[test]
fn the_side_towards_the_light_is_brighter() {
    let mesh = RenderMesh::new(&mesh::sphere(0.08, 64));
    let frame =
        render(&Scene { items: vec![item(&mesh, Pose::translation(0.65, 0.0, 0.85), 1)], ..Scene::default() }, &LENS, &view());
    let column: Vec<usize> = (0..LENS.height).map(|row| row * LENS.width + 80).filter(|&i| frame.depth_m[i] > 0.0).collect();
    let red = |idx: usize| frame.rgb[idx * 3];
    let (top, bottom) = (red(column[column.len() / 8]), red(column[column.len() * 7 / 8]));
    assert!(top > bottom + 40, "top {top}, bottom {bottom}");
}

fn noisy(seed: u64, frame_idx: u64, camera_idx: u64) -> (Frame, Frame) {
    let ball = RenderMesh::new(&mesh::sphere(0.08, 64));
    let table = RenderMesh::new(&mesh::cuboid(&Vector3::new(0.5, 0.5, 0.02)));
    let items = vec![item(&ball, Pose::translation(0.65, 0.0, 0.83), 1), item(&table, Pose::translation(0.65, 0.0, 0.73), 2)];
    let exact = render(&Scene { items, ..Scene::default() }, &LENS, &view());
    let mut frame = exact.clone();
    SensorNoise::default().apply(&mut frame, &LENS, seed, frame_idx, camera_idx);
    (exact, frame)
}

#[test]
fn noise_repeats_with_its_seed_and_differs_without() {
    assert_eq!(noisy(1, 2, 0).1, noisy(1, 2, 0).1);
    for (seed, frame_idx, camera_idx) in [(2, 2, 0), (1, 3, 0), (1, 2, 1)] {
        assert_ne!(noisy(1, 2, 0).1.depth_m, noisy(seed, frame_idx, camera_idx).1.depth_m);
    }
}

#[test]
fn noise_has_the_stated_spread_step_and_holes() {
    let (exact, frame) = noisy(3, 0, 0);
    let (mut sum, mut n, mut n_lost) = (0.0, 0, 0);
    for row in 2..LENS.height - 2 {
        for column in 2..LENS.width - 2 {
            let idx = row * LENS.width + column;
            let (d, measured) = (f64::from(exact.depth_m[idx]), f64::from(frame.depth_m[idx]));
            // Flat table only.
            if exact.instance_ids[idx] != 2 || exact.instance_ids[idx - 1] != 2 || exact.instance_ids[idx + LENS.width] != 2 {
                continue;
            }
            if measured == 0.0 {
                n_lost += 1;
                continue;
            }
            assert!(((measured * 1000.0).round() - measured * 1000.0).abs() < 1e-3, "{measured} is no whole millimetre");
            sum += ((measured - d) / (d * d)).powi(2);
            n += 1;
        }
    }
    let sigma = (sum / f64::from(n)).sqrt();
    assert!((0.0013..0.0020).contains(&sigma), "sigma {sigma} / m");
    assert!(n > 2000 && n_lost > 2 && n_lost * 20 < n, "{n} returns, {n_lost} lost");
    let edge = |ids: &Frame, idx: usize| ids.instance_ids[idx] == 1 && ids.instance_ids[idx - 1] == 2;
    let at_edge: Vec<usize> = (1..exact.depth_m.len()).filter(|&idx| edge(&exact, idx)).collect();
    let n_holes = at_edge.iter().filter(|&&idx| frame.depth_m[idx] == 0.0).count();
    assert!(n_holes > at_edge.len() / 5, "{n_holes} holes at {} edge pixels", at_edge.len());
}
