//! A pose generator as a dynamic library, in as few lines as it takes.
