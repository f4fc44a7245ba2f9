//! The renderer held against a slow one that traces a ray for each of many points of a pixel.
