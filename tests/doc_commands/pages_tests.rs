//! Tests of the parser on small pages.

use super::pages::{Inline, Mark, Page, in_one_line, usage};

#[test]
fn blocks_are_read_with_marks_commands_and_output() {
    let block = "  upm check a   # which\n\n  cat > b <<'END'\n  # c\n  END\n  upm run \\\n    b\n";
    let text = format!("`upm schema job`\n\n  <!-- run: exit 2 -->\n  ```sh\n{block}  ```\n\n```text\nbad\n```\n");
    let page = Page::read("page", &text);
    assert_eq!(page.faults, Vec::<String>::new());
    let [block] = &page.blocks[..] else { panic!("{page:?}") };
    assert_eq!((block.line, &block.mark, block.output.as_deref()), (5, &Mark::Exit(2), Some("bad\n")));
    let lines: Vec<(usize, String)> =
        block.commands.iter().map(|(offset, command)| (*offset, in_one_line(command))).collect();
    let expected = [(0, "upm check a"), (2, "cat > b <<'END'"), (5, "upm run b")];
    assert_eq!(lines, expected.map(|(offset, command)| (offset, command.to_owned())));
    assert_eq!(page.codes, ["upm schema job"]);
}

#[test]
fn slow_mark_is_for_the_page_and_leaves_the_block_its_own() {
    for text in [
        "<!-- run: slow -->\n<!-- run: exit 1 -->\n```sh\n```\n",
        "<!-- run: exit 1 -->\n```sh\n```\n<!-- run: slow -->\n",
    ] {
        let page = Page::read("page", text);
        assert!(page.is_slow && page.blocks[0].mark == Mark::Exit(1) && page.faults.is_empty(), "{page:?}");
    }
}

#[test]
fn prose_and_blocks_of_every_language_are_separate() {
    let page = Page::read("page", "# A\n```json 2 pennies\n{}\n```\n`a\nb`\n\n```\n# c\n```\n");
    assert_eq!(page.prose, "# A\n\n`a\nb`\n\n\n");
    assert_eq!(page.fences, [("json 2 pennies", "{}\n"), ("", "# c\n")].map(|(a, b)| (a.to_owned(), b.to_owned())));
    assert_eq!(page.codes, ["a b"]);
}

#[test]
fn breaches_of_the_rules_are_found() {
    for (text, fault) in [
        ("<!-- run: no -->\n```sh\n```\n", "expected a mark"),
        ("<!-- run: ci -->\n\n```sh\n```\n", "a mark without a block"),
        ("```text\n$ upm run\n```\n", "a command outside"),
        ("```console\nls\n```\n", "found \"console\""),
        ("```shell\n```\n", "found \"shell\""),
        ("<!-- run: ci -->\n```text\n```\n", "without commands"),
        ("<!-- run: no: two\nlines -->\n", "one line"),
    ] {
        let page = Page::read("page", text);
        assert!(page.faults.len() == 1 && page.faults[0].contains(fault), "{text}: {:?}", page.faults);
    }
}

#[test]
fn complete_inline_commands_are_distinguished_from_names() {
    let long = ["upm-lab mchip".to_owned()];
    for (code, expected) in [
        ("upm-lab feeder", Some(Inline::Prose)),
        ("upm-lab mchip", Some(Inline::Minutes)),
        ("upm run", Some(Inline::Named)),
        ("upm run JOB.json", Some(Inline::Named)),
        ("upm locate --stages", Some(Inline::Named)),
        ("cargo test --workspace", Some(Inline::Heavy)),
        ("cargo test", Some(Inline::Named)),
        ("cargo install --path .", Some(Inline::Named)),
        ("python3 tools/faults.py daemon", Some(Inline::Heavy)),
        ("upm-2", None),
    ] {
        assert_eq!(usage(code, &long), expected, "{code}");
    }
}
