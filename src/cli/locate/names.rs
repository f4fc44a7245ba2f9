use std::collections::BTreeSet;
use std::path::PathBuf;

/// A name for what is written of each picture: its file's without the ending, numbered where several have the same.
pub(super) fn of(images: &[PathBuf]) -> Vec<String> {
    let mut taken = BTreeSet::new();
    let mut free = |image: &PathBuf| {
        let stem = image.file_stem().map_or("picture".into(), |stem| stem.to_string_lossy().into_owned());
        let numbered = (2..).map(|number: u64| format!("{stem}-{number}"));
        let name = std::iter::once(stem.clone()).chain(numbered).find(|name| !taken.contains(name)).unwrap_or(stem);
        taken.insert(name.clone());
        name
    };
    images.iter().map(&mut free).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn equal_names_are_numbered() {
        let images = ["a/x.png", "b/x.jpg", "x-2.png", "x.png", ".."].map(PathBuf::from);
        assert_eq!(of(&images), ["x", "x-2", "x-2-2", "x-3", "picture"]);
    }
}
