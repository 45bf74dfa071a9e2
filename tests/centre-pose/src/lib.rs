//! A pose generator as a dynamic library, in as few lines as it takes: the palm above the centre of the part to hold, pointing
//! down, its closing target the hand's own. Stability is the share of the part's voxels that some camera saw.

#![expect(unsafe_code, reason = "this crate is the C boundary, seen from a plugin that uses nothing but it")]

use sfg_plugin_abi::{
    Entry, ErrorBuffer, Host, Instance, PalmPose, Pose, PoseGeneratorConfig, PoseGeneratorTable, PoseRequest, RawStatus,
    ScoreTerm, Text, capability, status, struct_size,
};
use std::{ffi::c_void, ptr, slice};

/// What the host reads first.
#[unsafe(no_mangle)]
pub static sfg_plugin_entry_v1: Entry = Entry::new(init, deinit, get_factory);

static TABLE: PoseGeneratorTable = PoseGeneratorTable {
    struct_size: struct_size::<PoseGeneratorTable>(),
    reserved: 0,
    name: Text::new("centre"),
    create: Some(create),
    destroy: Some(destroy),
    generate: Some(generate),
};

/// There is no state: every instance is the address of this.
static INSTANCE: u8 = 0;

unsafe extern "C" fn init(_: *const Host, _: *mut ErrorBuffer) -> RawStatus {
    status::OK
}

unsafe extern "C" fn deinit() {}

unsafe extern "C" fn get_factory(id: Text) -> *const c_void {
    // SAFETY: the id is lent until return.
    let known = unsafe { id.as_str() } == Some(capability::POSE_GENERATOR);
    if known { (&raw const TABLE).cast() } else { ptr::null() }
}

unsafe extern "C" fn create(_: *const PoseGeneratorConfig, instance: *mut *mut Instance, _: *mut ErrorBuffer) -> RawStatus {
    // SAFETY: `instance` is writable (obligation 2 of `create`).
    unsafe { instance.write((&raw const INSTANCE).cast_mut().cast()) };
    status::OK
}

unsafe extern "C" fn destroy(_: *mut Instance) {}

unsafe extern "C" fn generate(
    _: *mut Instance,
    request: *const PoseRequest,
    out: *mut PalmPose,
    capacity: usize,
    written: *mut usize,
    error: *mut ErrorBuffer,
) -> RawStatus {
    // SAFETY: the views are lent until return, in the shapes they state (obligation 2 of `generate`).
    let (request, grid, region, weights, grasp_types) = unsafe {
        let (request, grid, hand) = (&*request, &*(*request).tsdf, &*(*request).hand);
        let n = grid.edge.pow(3) as usize;
        let (region, weights) = (slice::from_raw_parts(request.affordance_region, n), slice::from_raw_parts(grid.weights, n));
        (request, grid, region, weights, slice::from_raw_parts(hand.grasp_types, hand.n_grasp_types))
    };
    let Some(profile) = grasp_types.iter().find(|profile| profile.grasp_type == request.grasp_type) else {
        // SAFETY: `error` is writable (obligation 4).
        unsafe { (*error).write("the hand does not know the grasp type") };
        return status::FAILED;
    };
    let edge = grid.edge as usize;
    let (mut sum, mut n_part, mut n_seen) = ([0.0; 3], 0.0, 0.0);
    for v in (0..region.len()).filter(|&v| region[v] != 0) {
        let in_grid = [v % edge, v / edge % edge, v / edge / edge].map(|i| grid.voxel_m * (i as f64 + 0.5));
        let in_base = grid.base_from_grid.transform(in_grid);
        sum = [sum[0] + in_base[0], sum[1] + in_base[1], sum[2] + in_base[2]];
        n_part += 1.0;
        n_seen += f64::from(weights[v] > 0.0);
    }
    if n_part == 0.0 || capacity == 0 {
        // SAFETY: `written` is writable (obligation 4).
        unsafe { written.write(0) };
        return status::OK;
    }
    let [x, y, z] = sum.map(|value| value / n_part);
    let mut pose = PalmPose {
        base_from_palm: Pose { translation_m: [x, y, z + profile.standoff_min_m], rotation_wxyz: [0.0, 1.0, 0.0, 0.0] },
        stability: n_seen / n_part,
        synergy: profile.c_tar,
        hand_side: request.hand_side,
        n_terms: 1,
        ..PalmPose::UNSET
    };
    pose.terms[0] = ScoreTerm::new("share_seen", pose.stability);
    // SAFETY: `capacity` is at least 1 (obligation 3), and `written` is writable (obligation 4).
    unsafe {
        out.write(pose);
        written.write(1);
    }
    status::OK
}
