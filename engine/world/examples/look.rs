//! Builds the pouring scene, prints its speed and writes what cameras and a free viewpoint see to `target/look/`.
//!
//! `cargo run -p sfg-world --example look`
#![expect(clippy::print_stdout, reason = "an example talks to its reader")]

use sfg_kinematics::RobotModel;
use sfg_render::Picture;
use sfg_types::{HandCommand, HandSide, RobotCommand};
use sfg_world::{ObjectSpec, SceneSpec, Viewpoint, World, load_object_model};
use std::error::Error;
use std::path::Path;
use std::time::Instant;

fn main() -> Result<(), Box<dyn Error>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let robot = RobotModel::load(&root.join("scenarios/robots/curi.yaml"))?;
    let object = |name: &str, x_m, y_m| -> Result<ObjectSpec, Box<dyn Error>> {
        let model = load_object_model(&root.join(format!("scenarios/objects/{name}.yaml")))?;
        Ok(ObjectSpec::from_model(name, &model, [0.5; 3], x_m, y_m, 0.3)?)
    };
    for n_grains in [0, 150] {
        let objects =
            vec![object("bottle", 0.65, 0.20)?.with_grains(n_grains), object("bowl", 0.68, -0.12)?, object("mug", 0.55, -0.32)?];
        let spec = SceneSpec { objects, seed: 7, ..SceneSpec::default() };
        let start = Instant::now();
        let mut world = World::new(&spec, &robot, HandSide::Left)?;
        println!("{n_grains} grains: built and settled in {:.2} s", start.elapsed().as_secs_f64());
        let q = robot.left.home_q.clone();
        let command = RobotCommand { side: HandSide::Left, dq: vec![0.0; q.len()], q, hand: HandCommand::default() };
        let (start, n_steps) = (Instant::now(), 500);
        for _ in 0..n_steps {
            world.step(&command)?;
        }
        println!(
            "{n_grains} grains: {:.0} steps/s, state {:016x}",
            f64::from(n_steps) / start.elapsed().as_secs_f64(),
            world.state_hash()
        );
        if n_grains == 0 {
            continue;
        }
        let folder = root.join("target/look");
        std::fs::create_dir_all(&folder)?;
        let start = Instant::now();
        let observation = world.observe();
        println!("two views in {:.0} ms", start.elapsed().as_secs_f64() * 1e3);
        let views: Vec<Picture> = observation
            .views
            .iter()
            .map(|view| {
                let (width, height) = (view.intrinsics.width, view.intrinsics.height);
                let colour = Picture::from_rgb(width, height, &view.rgb);
                Picture::stacked(&[colour, Picture::from_depth(width, height, &view.depth_m, 0.4, 1.4)], 4)
            })
            .collect();
        std::fs::write(folder.join("cameras.png"), Picture::beside(&views, 4).png()?)?;
        std::fs::write(folder.join("scene.png"), world.picture(&Viewpoint::default()).png()?)?;
    }
    Ok(())
}
