//! The `upm` command.

fn main() {}
