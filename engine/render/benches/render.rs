//! Two camera views of about 50,000 triangles and 150 grains: `cargo bench -p sfg-render --bench render`.
//!
//! Prints median and 95th percentile with a checksum and writes `target/bench/render.json`. `--profile dev` shows what tests see.
#![expect(clippy::print_stdout, reason = "a benchmark reports to its user")]

use nalgebra::Vector3;
use sfg_geometry::mesh;
use sfg_render::{Finish, Item, RenderMesh, Scene, SensorNoise, Sphere, camera, render};
use sfg_types::{Point, Pose};
use std::path::Path;
use std::time::Instant;

const N_ITEMS: usize = 1000;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let ball = RenderMesh::new(&mesh::sphere(0.06, 88));
    let table = RenderMesh::new(&mesh::cuboid(&Vector3::new(0.4, 0.6, 0.02)));
    let n_balls = 50_000 / ball.n_triangles();
    let scene_at = |step: usize| {
        let item = |mesh, x, y, z| Item {
            mesh,
            base_from_mesh: Pose::translation(x, y, z),
            colour: [180, 90, 60],
            finish: Finish::Plain,
            instance_id: 1,
            part_id: 0,
        };
        let mut scene = Scene::default();
        scene.items.push(Item { finish: Finish::Wood, ..item(&table, 0.65, 0.0, 0.73) });
        for i in 0..n_balls {
            let y = 0.16 * (i as f64 - n_balls as f64 / 2.0) / 2.0;
            scene.items.push(item(&ball, 0.55 + 0.15 * (i % 2) as f64 + 1e-4 * step as f64, y, 0.81));
        }
        scene.spheres.extend((0..150).map(|i| Sphere {
            centre_in_base: Point::new(0.5 + 0.002 * f64::from(i), 0.001 * f64::from(i * 37 % 150), 0.92),
            radius_m: 0.004,
            colour: [60, 120, 220],
            instance_id: 2,
            part_id: 0,
        }));
        scene
    };
    let views = [0.3, -0.3].map(|y| camera::look_at(&Point::new(0.1, y, 1.35), &Point::new(0.65, 0.0, 0.8)));
    let (mut exact_ms, mut noise_ms) = (Vec::new(), Vec::new());
    let mut checksum = 0_u64;
    for step in 0..N_ITEMS {
        let scene = scene_at(step);
        let start = Instant::now();
        let mut frames: Vec<_> = views.iter().map(|pose| render(&scene, &camera::D435I, pose)).collect();
        exact_ms.push(start.elapsed().as_secs_f64() * 1e3);
        let start = Instant::now();
        for (idx, frame) in frames.iter_mut().enumerate() {
            SensorNoise::default().apply(frame, &camera::D435I, 1, step as u64, idx as u64);
            checksum += frame.rgb.iter().map(|&v| u64::from(v)).sum::<u64>();
            checksum += frame.depth_m.iter().map(|&d| u64::from(d.to_bits())).sum::<u64>();
        }
        noise_ms.push(start.elapsed().as_secs_f64() * 1e3);
    }
    let rows = [("two_640x480_views_50k_triangles", exact_ms), ("noise_of_two_views", noise_ms)].map(|(name, mut times)| {
        times.sort_by(f64::total_cmp);
        let (median, p95) = (times[N_ITEMS / 2], times[N_ITEMS * 95 / 100]);
        println!("{name}: median {median:.2} ms, p95 {p95:.2} ms, n {N_ITEMS}");
        serde_json::json!({"bench": name, "unit": "ms", "median": median, "p95": p95, "n": N_ITEMS, "peer": null})
    });
    println!("checksum {checksum}");
    let out = Path::new(env!("CARGO_MANIFEST_DIR")).join("../../target/bench");
    std::fs::create_dir_all(&out)?;
    std::fs::write(out.join("render.json"), serde_json::to_string_pretty(&rows)?)?;
    Ok(())
}
