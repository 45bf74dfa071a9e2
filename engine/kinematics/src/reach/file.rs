//! The file of a map: a line with the version, a line with the header as JSON, masks, joint shares, and a SHA-256 of all before.

use crate::chain::Chain;
use crate::error::KinematicsError;
use crate::reach::build::ReachBuild;
use crate::reach::map::{ReachHeader, ReachMap};
use crate::reach::rotations::N_ROTATIONS;
use sha2::{Digest as _, Sha256};
use std::io::{Read as _, Write as _};
use std::path::Path;

const MAGIC: &str = "sfg-reach";
/// Raised whenever cells, rotations or the layout of the file change.
const VERSION: u32 = 1;
const HASH_BYTES: usize = 32;
/// Longer files are no maps: a map of 5 cm has below 20 MB.
const MAX_BYTES: u64 = 1 << 30;
const BUILD_AGAIN: &str = "delete it and build it again with `sfg robot reach build`";

impl ReachMap {
    /// Reads a complete map of `chain`.
    ///
    /// # Errors
    /// [`KinematicsError::ReadFile`], and [`KinematicsError::Reach`] for a file that is no map, is damaged, cut short or
    /// incomplete, or was built for another arm.
    pub fn load(path: &Path, chain: &Chain) -> Result<Self, KinematicsError> {
        let (map, _) = read(path, chain)?;
        if map.header.is_complete {
            return Ok(map);
        }
        let n = map.header.n_passes;
        Err(bad(path, format!("its build stopped after pass {n}; `sfg robot reach build` goes on from there")))
    }

    /// Writes the map; a file of that name is replaced when the new one is complete.
    ///
    /// # Errors
    /// [`KinematicsError::Reach`] with the reason.
    pub fn save(&self, path: &Path) -> Result<(), KinematicsError> {
        write(path, self, &[])
    }
}

impl ReachBuild {
    /// Writes the state between two passes, to go on with [`Self::resume`].
    ///
    /// # Errors
    /// As [`ReachMap::save`].
    pub fn save(&self, path: &Path) -> Result<(), KinematicsError> {
        write(path, &self.map, &self.fresh)
    }

    /// Goes on with a build that was saved.
    ///
    /// # Errors
    /// As [`ReachMap::load`]; a complete map is none.
    pub fn resume(path: &Path, chain: &Chain) -> Result<Self, KinematicsError> {
        let (map, fresh) = read(path, chain)?;
        Ok(Self { map, fresh })
    }
}

fn bad(path: &Path, message: String) -> KinematicsError {
    KinematicsError::Reach { path: path.to_owned(), message }
}

/// Bytes of the masks, the shares and, while the map is incomplete, the masks of the last pass.
fn content_bytes(header: &ReachHeader, n_reached: usize) -> Option<usize> {
    let n_voxels = header.size.iter().try_fold(1_usize, |n, size| n.checked_mul(*size))?;
    let n_masks = if header.is_complete { n_voxels } else { n_voxels.checked_mul(2)? };
    n_masks.checked_mul(8)?.checked_add(n_reached.checked_mul(header.n_joints)?)
}

fn write(path: &Path, map: &ReachMap, fresh: &[u64]) -> Result<(), KinematicsError> {
    let mut bytes = format!("{MAGIC} {VERSION}\n").into_bytes();
    let header = serde_json::to_string(&map.header).map_err(|error| bad(path, error.to_string()))?;
    bytes.extend(header.bytes().chain([b'\n']));
    let fresh = if map.header.is_complete { &[] } else { fresh };
    bytes.extend(map.masks.iter().chain(fresh).flat_map(|mask| mask.to_le_bytes()));
    bytes.extend(&map.shares);
    let hash = Sha256::digest(&bytes);
    bytes.extend_from_slice(hash.as_slice());
    // A kill in mid-writing leaves the old file.
    let beside = path.with_extension("reach-part");
    let written = std::fs::File::create(&beside)
        .and_then(|mut file| file.write_all(&bytes).and_then(|()| file.sync_all()))
        .and_then(|()| std::fs::rename(&beside, path));
    written.map_err(|error| bad(path, format!("cannot write it: {error}; check that the folder exists and may be written to")))
}

fn read(path: &Path, chain: &Chain) -> Result<(ReachMap, Vec<u64>), KinematicsError> {
    let unread = |source| KinematicsError::ReadFile { path: path.to_owned(), source };
    let mut bytes = Vec::new();
    std::fs::File::open(path).map_err(unread)?.take(MAX_BYTES).read_to_end(&mut bytes).map_err(unread)?;
    let bad = |message: String| bad(path, message);
    let no_map = || bad(format!("is no reachability map: expected a first line \"{MAGIC} {VERSION}\"; check its name"));
    let (first, rest) = line(&bytes).ok_or_else(no_map)?;
    let version = first.strip_prefix(MAGIC).and_then(|rest| rest.trim().parse::<u32>().ok()).ok_or_else(no_map)?;
    if version != VERSION {
        return Err(bad(format!("has version {version}, this program reads {VERSION}; {BUILD_AGAIN}")));
    }
    let short = || bad(format!("is cut short at {} bytes; {BUILD_AGAIN}", bytes.len()));
    let (header, rest) = line(rest).ok_or_else(short)?;
    let header: ReachHeader =
        serde_json::from_str(header).map_err(|error| bad(format!("its header is damaged: {error}; {BUILD_AGAIN}")))?;
    let expected = content_bytes(&header, header.n_reached).and_then(|n| n.checked_add(HASH_BYTES));
    if expected.is_none_or(|n| rest.len() < n) {
        return Err(short());
    }
    let (content, hash) = bytes.split_at(bytes.len() - HASH_BYTES);
    let is_whole = expected == Some(rest.len()) && Sha256::digest(content).as_slice() == hash;
    let is_sane = header.n_rotations == N_ROTATIONS && header.resolution_m > 0.0 && header.size.iter().all(|n| *n > 1);
    if !is_whole || !is_sane {
        return Err(bad(format!("is damaged: its content does not have the hash at its end; {BUILD_AGAIN}")));
    }
    let n_voxels: usize = header.size.iter().product();
    let masks_at = |from: usize| -> Vec<u64> {
        rest[8 * from..8 * (from + n_voxels)]
            .chunks_exact(8)
            .map(|bytes| bytes.iter().rev().fold(0, |mask, byte| mask << 8 | u64::from(*byte)))
            .collect()
    };
    let masks = masks_at(0);
    let fresh = if header.is_complete { Vec::new() } else { masks_at(n_voxels) };
    let n_masks = n_voxels + fresh.len();
    let shares = rest[8 * n_masks..rest.len() - HASH_BYTES].to_vec();
    let map = ReachMap::from_parts(header, masks, shares)
        .ok_or_else(|| bad(format!("is damaged: cells and configurations disagree; {BUILD_AGAIN}")))?;
    if !map.is_of(chain) {
        let header = map.header();
        return Err(bad(format!(
            "was built for another arm than this one (it says {:?}, {} arm, and its lengths, axes or limits differ): {BUILD_AGAIN}",
            header.robot, header.arm
        )));
    }
    Ok((map, fresh))
}

/// The text up to the first line feed, and what comes after.
fn line(bytes: &[u8]) -> Option<(&str, &[u8])> {
    let end = bytes.iter().position(|byte| *byte == b'\n')?;
    Some((std::str::from_utf8(&bytes[..end]).ok()?, &bytes[end + 1..]))
}
