//! CPU renderer: meshes to RGB-D images and pictures.
