//! Laws of a grounder.

use super::views_of_a_table::{Block, table_observation};
use super::{Laws, scenes::TABLE_HEIGHT_M};
use crate::{AffordanceQuery, Grounder, SelfSphere};
use sfg_types::{AffordanceMask, Observation, SceneInventory};

/// How far the centre of a plain block may be missed, metres.
const CENTRE_TOLERANCE_M: f64 = 0.03;

/// Every law that `grounder` breaks: a bare table is an empty inventory, a plain block is found where it stands unless it is the
/// robot's own body, clusters are numbered, finite and of positive size with names best first, masks keep the size of their view
/// and hold 0 or 1, the same views give the same answer, and views without any depth neither panic nor show things.
///
/// # Errors
/// The broken laws, a sentence each.
pub fn grounder_suite(grounder: &mut dyn Grounder) -> Result<(), Vec<String>> {
    let mut laws = Laws::default();
    bare_table(grounder, &mut laws);
    one_block(grounder, &mut laws);
    two_blocks(grounder, &mut laws);
    blind(grounder, &mut laws);
    laws.into_result()
}

fn red_block() -> Block {
    Block { at_m: [0.65, 0.10], size_m: [0.08, 0.06, 0.16], rgb: [200, 40, 40] }
}

fn bare_table(grounder: &mut dyn Grounder, laws: &mut Laws) {
    if let Some(inventory) = laws.ok("bare table", grounder.list_scene(&table_observation(&[]), &[])) {
        laws.check(inventory.clusters.is_empty(), || format!("bare table: {} things were listed", inventory.clusters.len()));
    }
}

fn one_block(grounder: &mut dyn Grounder, laws: &mut Laws) {
    let block = red_block();
    let observation = table_observation(&[block]);
    let Some(inventory) = laws.ok("one block", grounder.list_scene(&observation, &[])) else { return };
    let again = laws.ok("one block, again", grounder.list_scene(&observation, &[]));
    laws.check(again.is_none_or(|again| again == inventory), || {
        "one block: the same views gave two different inventories".into()
    });
    check_inventory("one block", &inventory, laws);
    laws.check(inventory.clusters.len() == 1, || format!("one block: {} things were listed", inventory.clusters.len()));
    let table_miss = (inventory.table_height_m - TABLE_HEIGHT_M).abs();
    laws.check(table_miss < 0.01, || format!("one block: the table height is {table_miss:.3} m off"));
    let Some(cluster) = inventory.clusters.first() else { return };
    let miss = (cluster.centre_in_base - block.centre_in_base()).norm();
    laws.check(miss < CENTRE_TOLERANCE_M, || format!("one block: its centre is missed by {miss:.3} m"));

    let robot = [SelfSphere { centre_in_base: block.centre_in_base(), radius_m: 0.12 }];
    if let Some(without) = laws.ok("the robot's own body", grounder.list_scene(&observation, &robot)) {
        laws.check(without.clusters.is_empty(), || "the robot's own body was listed as a thing".into());
    }
    for affordance in ["body", "no such part"] {
        let query = AffordanceQuery { observation: &observation, cluster, object_name: "box", affordance };
        check_masks(grounder, &query, laws);
    }
}

fn two_blocks(grounder: &mut dyn Grounder, laws: &mut Laws) {
    let blue = Block { at_m: [0.60, -0.20], size_m: [0.06, 0.06, 0.10], rgb: [40, 60, 200] };
    if let Some(inventory) = laws.ok("two blocks", grounder.list_scene(&table_observation(&[red_block(), blue]), &[])) {
        check_inventory("two blocks", &inventory, laws);
        laws.check(inventory.clusters.len() == 2, || format!("two blocks: {} things were listed", inventory.clusters.len()));
    }
}

/// Both an error and an empty inventory are answers to cameras that see nothing; a thing would be invented.
fn blind(grounder: &mut dyn Grounder, laws: &mut Laws) {
    let mut dark = table_observation(&[]);
    for value in [0.0, f32::NAN] {
        dark.views.iter_mut().for_each(|view| view.depth_m.fill(value));
        let listed = grounder.list_scene(&dark, &[]).map_or(0, |inventory| inventory.clusters.len());
        laws.check(listed == 0, || format!("all depths {value}: {listed} things were listed"));
    }
    let listed = grounder.list_scene(&Observation::default(), &[]).map_or(0, |inventory| inventory.clusters.len());
    laws.check(listed == 0, || format!("no view: {listed} things were listed"));
}

fn check_inventory(case: &str, inventory: &SceneInventory, laws: &mut Laws) {
    for (i, cluster) in inventory.clusters.iter().enumerate() {
        let case = format!("{case}, thing {i}");
        laws.check(cluster.id as usize == i, || format!("{case}: its number is {}", cluster.id));
        laws.check(cluster.size_m.iter().all(|side| side.is_finite() && *side > 0.0), || {
            format!("{case}: size {:?}", cluster.size_m)
        });
        laws.check(cluster.centre_in_base.iter().all(|value| value.is_finite()), || format!("{case}: its centre is not finite"));
        laws.check(cluster.yaw_rad.is_finite(), || format!("{case}: its yaw is not finite"));
        laws.check(!cluster.points_in_base.is_empty(), || format!("{case}: it has no points"));
        let in_range = cluster.names.iter().all(|name| (0.0..=1.0).contains(&name.score));
        laws.check(in_range, || format!("{case}: a name's score is outside [0, 1]"));
        let sorted = cluster.names.windows(2).all(|pair| pair[0].score >= pair[1].score);
        laws.check(sorted, || format!("{case}: names are not sorted best first"));
    }
}

fn check_masks(grounder: &mut dyn Grounder, query: &AffordanceQuery<'_>, laws: &mut Laws) {
    let case = format!("part {:?}", query.affordance);
    let views = &query.observation.views;
    let blank = || -> Vec<AffordanceMask> {
        views.iter().map(|view| AffordanceMask::empty(&view.camera, view.intrinsics.width, view.intrinsics.height)).collect()
    };
    let (mut masks, mut again) = (blank(), blank());
    if laws.ok(&case, grounder.ground(query, &mut masks)).is_none() {
        return;
    }
    laws.ok(&case, grounder.ground(query, &mut again));
    laws.check(masks == again, || format!("{case}: the same query marked different pixels"));
    for (mask, view) in masks.iter().zip(views) {
        let (width, height) = (view.intrinsics.width, view.intrinsics.height);
        let sized = (mask.width, mask.height, mask.pixels.len()) == (width, height, width * height) && mask.camera == view.camera;
        laws.check(sized, || format!("{case}: the mask of camera {:?} is not of that view", view.camera));
        laws.check(mask.pixels.iter().all(|&pixel| pixel <= 1), || format!("{case}: a mask holds values other than 0 and 1"));
    }
}
