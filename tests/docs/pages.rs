//! Pages of the documentation: prose, inline code and fenced blocks with their marks. CONTRIBUTING.md has the rules for
//! those who write pages.

use std::fs;
use std::path::{Path, PathBuf};

/// A fenced block.
#[derive(Debug)]
pub struct Block {
    /// Line of its text's beginning, from 0.
    pub line: usize,
    /// Language, and what else is after the fence.
    pub info: String,
    /// Words of the mark above it.
    pub mark: String,
    /// Its lines without the indent of the fence.
    pub text: String,
}

/// A page with its blocks.
#[derive(Debug, Default)]
pub struct Page {
    pub name: String,
    /// Text outside fenced blocks and marks.
    pub prose: String,
    pub blocks: Vec<Block>,
    /// Words of all marks.
    pub marks: Vec<String>,
}

impl Page {
    pub fn read(file: &Path) -> Self {
        let name = file.strip_prefix(env!("CARGO_MANIFEST_DIR")).unwrap_or(file).display().to_string();
        let mut page = Self { name, ..Self::default() };
        let (mut indent, mut mark) = (None, String::new());
        for (i, line) in fs::read_to_string(file).unwrap().lines().enumerate() {
            let bare = line.trim_start();
            if let Some(info) = bare.strip_prefix("```") {
                indent = if indent.is_some() { None } else { Some(line.len() - bare.len()) };
                if indent.is_some() {
                    let (info, mark) = (info.to_owned(), std::mem::take(&mut mark));
                    page.blocks.push(Block { line: i + 1, info, mark, text: String::new() });
                    page.prose.push('\n');
                }
            } else if let Some(indent) = indent {
                page.blocks.last_mut().unwrap().text.extend([line.get(indent..).unwrap_or_default(), "\n"]);
            } else if let Some(words) = bare.strip_prefix("<!-- run: ") {
                mark = words.trim_end_matches(" -->").to_owned();
                page.marks.push(mark.clone());
            } else {
                page.prose.extend([line, "\n"]);
            }
        }
        page
    }

    /// Inline code: it may be on two lines, but not across an empty one.
    pub fn codes(&self) -> Vec<String> {
        let paragraphs = self.prose.split("\n\n");
        let codes = paragraphs.flat_map(|paragraph| paragraph.split('`').skip(1).step_by(2));
        codes.map(|code| code.split_whitespace().collect::<Vec<_>>().join(" ")).collect()
    }
}

/// Markdown files of the project: those at the top and in `docs/`.
pub fn files() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR"));
    let entries = [root.to_owned(), root.join("docs")].into_iter().flat_map(|folder| fs::read_dir(folder).unwrap());
    let mut files: Vec<PathBuf> = entries.map(|entry| entry.unwrap().path()).collect();
    files.retain(|path| path.extension().is_some_and(|extension| extension == "md"));
    files.sort();
    files
}

/// All pages but the changelog.
pub fn all() -> Vec<Page> {
    files().iter().filter(|file| !file.ends_with("CHANGELOG.md")).map(|file| Page::read(file)).collect()
}
