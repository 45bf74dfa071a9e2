//! Fusion, surface extraction and key point on varied views: `cargo bench -p sfg-geometry --bench geometry`.
//!
//! Prints median and 95th percentile with a checksum and writes `target/bench/geometry.json`.
#![expect(clippy::print_stdout, reason = "a benchmark reports to its user")]

use sfg_geometry::{TsdfView, affordance_region, fuse_views, surface_points, task_key_point};
use sfg_types::{AffordanceMask, CameraIntrinsics, Point, Pose, RgbdImage, Vector};
use std::path::Path;
use std::time::Instant;

const N_ITEMS: usize = 1000;
const CAMERA: CameraIntrinsics = CameraIntrinsics { width: 640, height: 480, fx: 462.1, fy: 462.1, cx: 319.5, cy: 239.5 };

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let centre = Point::new(0.65, 0.1, 0.85);
    // Eight scenes, each with two views of a ball of another size on another ground.
    let scenes: Vec<Vec<(RgbdImage, AffordanceMask)>> = (0..8)
        .map(|i| {
            let radius = 0.03 + 0.006 * f64::from(i);
            [-0.35, 0.35].map(|side| ball(&centre, radius, &Point::new(0.15 + 0.01 * f64::from(i), side, 1.35))).into()
        })
        .collect();
    let mut rows = Vec::new();
    let mut checksum = 0.0_f64;
    bench("tsdf_from_two_640x480_views", &mut rows, |i| {
        let views = tsdf_views(&scenes[i % scenes.len()]);
        let shifted = centre + Vector::new(0.0, 0.0, 1e-5 * i as f64);
        checksum += fuse_views(&shifted, &views).distances.iter().map(|&d| f64::from(d)).sum::<f64>();
    });
    let grids: Vec<_> = scenes.iter().map(|scene| fuse_views(&centre, &tsdf_views(scene))).collect();
    bench("surface_points", &mut rows, |i| {
        checksum += surface_points(&grids[i % grids.len()]).iter().map(|p| p.point_in_base.z + p.normal_in_base.x).sum::<f64>();
    });
    let observations: Vec<(Vec<AffordanceMask>, Vec<RgbdImage>)> =
        scenes.iter().map(|scene| scene.iter().map(|(view, mask)| (mask.clone(), view.clone())).unzip()).collect();
    bench("key_point_and_region", &mut rows, |i| {
        let (masks, views) = &observations[i % observations.len()];
        if let Ok(key_point) = task_key_point(masks, views) {
            let region = affordance_region(&grids[i % grids.len()], &key_point.part_points_in_base);
            checksum += key_point.point_in_base.x + f64::from(region.iter().map(|&v| u32::from(v)).sum::<u32>());
        }
    });
    println!("checksum {checksum:.6}");
    let out = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/bench");
    std::fs::create_dir_all(&out)?;
    std::fs::write(out.join("geometry.json"), serde_json::to_string_pretty(&rows)?)?;
    Ok(())
}

fn tsdf_views(scene: &[(RgbdImage, AffordanceMask)]) -> Vec<TsdfView<'_>> {
    scene.iter().map(|(image, mask)| TsdfView { image, object_mask: Some(&mask.pixels) }).collect()
}

fn bench(name: &str, rows: &mut Vec<serde_json::Value>, mut work: impl FnMut(usize)) {
    let mut times_ms: Vec<f64> = (0..N_ITEMS)
        .map(|i| {
            let start = Instant::now();
            work(i);
            start.elapsed().as_secs_f64() * 1e3
        })
        .collect();
    times_ms.sort_by(f64::total_cmp);
    let (median, p95) = (times_ms[N_ITEMS / 2], times_ms[N_ITEMS * 95 / 100]);
    println!("{name}: median {median:.3} ms, p95 {p95:.3} ms, n {N_ITEMS}");
    rows.push(serde_json::json!({"bench": name, "unit": "ms", "median": median, "p95": p95, "n": N_ITEMS, "peer": null}));
}

/// A ball on a plane 0.1 m below its centre.
fn ball(centre: &Point, radius: f64, eye: &Point) -> (RgbdImage, AffordanceMask) {
    let rotation = nalgebra::UnitQuaternion::face_towards(&(centre - eye), &-Vector::z());
    let base_from_camera = Pose::from_parts(eye.coords.into(), rotation);
    let n = CAMERA.width * CAMERA.height;
    let (mut depth_m, mut pixels) = (vec![0.0; n], vec![0; n]);
    for (idx, (depth, pixel)) in depth_m.iter_mut().zip(&mut pixels).enumerate() {
        let ray = CAMERA.deproject((idx % CAMERA.width) as f64, (idx / CAMERA.width) as f64, 1.0).coords;
        let in_base = rotation * ray;
        let to_ball = rotation.inverse() * (centre - eye);
        let (b, c) = (ray.dot(&to_ball), to_ball.norm_squared() - radius * radius);
        let root = b * b - ray.norm_squared() * c;
        if root > 0.0 {
            *depth = ((b - root.sqrt()) / ray.norm_squared()) as f32;
            *pixel = 1;
        } else if in_base.z < -0.05 {
            *depth = ((centre.z - 0.1 - eye.z) / in_base.z) as f32;
        }
    }
    let image = RgbdImage { camera: "bench".to_owned(), intrinsics: CAMERA, base_from_camera, rgb: vec![0; n * 3], depth_m };
    (image, AffordanceMask { camera: "bench".to_owned(), width: CAMERA.width, height: CAMERA.height, pixels })
}
