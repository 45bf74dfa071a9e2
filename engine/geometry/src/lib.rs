//! Cameras, depth to TSDF, key points, signed distance fields, object models and meshes.
