use std::path::{Path as FilePath, PathBuf};

/// Where a document comes from.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Origin {
    /// What faults call it: the file as the person named it.
    pub file: String,
    /// Folder that paths in it are relative to; `None` where files may not be named, as over HTTP.
    pub folder: Option<PathBuf>,
}

impl Origin {
    /// The file at `path`.
    pub fn of_file(path: &FilePath) -> Self {
        let folder = path.parent().map(FilePath::to_path_buf).unwrap_or_default();
        Self { file: path.display().to_string(), folder: Some(folder) }
    }

    /// A document that came without a file and may name none.
    pub fn of_request(name: &str) -> Self {
        Self { file: name.to_owned(), folder: None }
    }

    /// The file that the document calls `named`.
    pub(super) fn resolve(&self, named: &str) -> Option<PathBuf> {
        self.folder.as_ref().map(|folder| folder.join(named))
    }
}
