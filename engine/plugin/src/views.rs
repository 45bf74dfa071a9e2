//! The contracts' types as C views and back.
//!
//! A `*Lent` struct borrows a Rust value and keeps the small arrays that its view points into; the view is good as long as the
//! struct lives. The functions that read a view copy everything, so nothing of the other side is kept after a call.

mod error;
mod lend;
mod read;
mod values;

pub use error::ViewError;
pub use lend::{HandLent, RequestLent, config_view};
pub use read::{OwnedPoseRequest, SizeFirst, hand_profile, read_sized, text};
pub use values::{
    UNIT_TOLERANCE, candidate, grasp_type, grasp_type_number, hand_side, hand_side_number, palm_pose_view, pose, pose_view,
};

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used, reason = "tests fail by panicking")]
    #![expect(unsafe_code, reason = "views are read")]

    use super::*;
    use crate::testing;
    use sfg_plugin_abi as abi;
    use sfg_types::{GraspType, HandSide, ScoreTerm};

    #[test]
    fn a_request_crosses_unchanged() {
        let hand = testing::hand_profile();
        let scene = testing::PoseScene::cylinder();
        let request = scene.request(&hand, HandSide::Right, GraspType::Tripod);
        let hand_lent = HandLent::new(&hand);
        let lent = RequestLent::new(&request, &hand_lent);
        let view = lent.view();
        // SAFETY: `lent` keeps everything the view points to.
        let back = unsafe { OwnedPoseRequest::read(&raw const view) }.unwrap();
        assert_eq!(&back.tsdf, request.tsdf);
        assert_eq!(&back.affordance_region, request.affordance_region);
        assert_eq!(&back.key_point, request.key_point);
        assert_eq!(&back.hand, request.hand);
        assert_eq!((back.hand_side, back.grasp_type), (HandSide::Right, GraspType::Tripod));
        assert_eq!(back.table_height_m, request.table_height_m);
    }

    #[test]
    fn every_grasp_type_has_its_own_number() {
        for (i, kind) in GraspType::ALL.into_iter().enumerate() {
            assert_eq!(grasp_type_number(kind) as usize, i + 1, "t1..t12 are the numbers of the project");
            assert_eq!(grasp_type(grasp_type_number(kind)), Ok(kind));
        }
        assert!(grasp_type(0).is_err() && grasp_type(13).is_err() && hand_side(2).is_err());
    }

    #[test]
    fn a_short_or_null_struct_is_refused() {
        let mut view = HandLent::new(&testing::hand_profile()).view();
        view.struct_size -= 8;
        let expected = abi::struct_size::<abi::HandProfile>();
        // SAFETY: the struct is shorter than it could be, and refused before its pointers are read.
        let refused = unsafe { hand_profile(&raw const view) };
        assert_eq!(refused, Err(ViewError::TooShort { what: "the hand profile", size: expected - 8, expected }));
        // SAFETY: null is allowed.
        assert_eq!(unsafe { hand_profile(std::ptr::null()) }, Err(ViewError::Null { what: "the hand profile" }));
    }

    #[track_caller]
    fn check_refused(change: impl FnOnce(&mut abi::PalmPose), expected: &str) {
        let mut view = abi::PalmPose::UNSET;
        assert!(candidate(&view).is_ok());
        change(&mut view);
        assert_eq!(candidate(&view).map_err(|error| error.to_string()), Err(expected.to_owned()));
    }

    #[test]
    fn candidates_from_the_other_side_are_checked() {
        check_refused(|view| view.base_from_palm.translation_m[1] = f64::NAN, "the palm pose is not finite");
        check_refused(
            |view| view.base_from_palm.rotation_wxyz[0] = 0.9,
            "the quaternion of the palm pose has norm 0.900000, not 1",
        );
        check_refused(|view| view.stability = 1.5, "the stability is 1.5, outside [0, 1]");
        check_refused(|view| view.stability = f64::INFINITY, "the stability is not finite");
        check_refused(|view| view.synergy[1] = -1.1, "c2 is -1.1, outside [-1, 1]");
        check_refused(|view| view.hand_side = 7, "hand side 7 is unknown");
        check_refused(|view| view.n_terms = 17, "number of score terms 17 is unknown");
        check_refused(
            |view| {
                view.n_terms = 1;
                view.terms[0].name[0] = 0xff;
            },
            "a score term is not UTF-8",
        );
    }

    #[test]
    fn score_terms_cross_or_are_refused_never_cut() {
        let term = |name: &str| ScoreTerm { name: name.to_owned(), value: 0.25 };
        let mut here = candidate(&abi::PalmPose::UNSET).unwrap();
        here.terms = vec![term("wrench_margin"), term("exactly_thirty_two_bytes_in_name")];
        assert_eq!(candidate(&palm_pose_view(&here).unwrap()), Ok(here.clone()));
        here.terms.push(term("a_name_of_more_than_thirty_two_byte"));
        assert!(palm_pose_view(&here).is_err());
        here.terms = vec![term("n"); abi::TERMS_CAPACITY + 1];
        assert!(palm_pose_view(&here).is_err());
    }
}
