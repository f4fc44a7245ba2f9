#!/usr/bin/env python3
"""Runs the commands of the pages that are longer than a minute: blocks marked `minutes`, and inline code so marked.

usage: doc_commands.py [--upm target/debug/upm] [--page docs/lab.md ...] [--heavy] [--limit SECONDS] [--list]

Pages are README.md, CONTRIBUTING.md, ARCHITECTURE.md and docs/*.md; CONTRIBUTING.md has the rules by which they mark
their commands, and tests/doc_commands.rs runs all shorter ones. Commands of `upm` run in a folder that `upm init .`
made, all others in the repository, each once. Prints page, seconds, exit status and command; ends with status 1 when a
command fails.

--heavy  also `cargo ...` and `python3 tools/...` of prose and tables: builds and benchmarks, hours in all.
--limit  ends a command after so many seconds; it counts as failed.
--list   runs nothing and prints all commands: page, runner, command.
"""
import argparse
import os
import pathlib
import re
import signal
import subprocess
import sys
import tempfile
import time

ROOT = pathlib.Path(__file__).resolve().parents[1]
SHOWN_LINES = 15

# something that the reader puts in: two capital letters in a row, brackets, an ellipsis
PLACEHOLDER = re.compile(r"[A-Z]{2}|\[|…|\.\.\.")


class Page:
    """Blocks of commands, each with its mark, and inline code of a page."""

    def __init__(self, name, text):
        self.name, self.blocks, self.is_slow, self.long = name, [], False, []
        fence, mark, prose = None, "", []
        for line in text.splitlines():
            bare = line.lstrip()
            if fence is not None:
                if bare.startswith("```"):
                    language, indent, lines, block_mark = fence
                    if language == "sh":
                        self.blocks.append((block_mark, commands([line[indent:] for line in lines])))
                    fence = None
                else:
                    fence[2].append(line)
            elif bare.startswith("```"):
                fence, mark = (bare[3:], len(line) - len(bare), [], mark), ""
                prose.append("")
            elif bare.startswith("<!-- run: "):
                mark = self.mark(bare.removeprefix("<!-- run: ").removesuffix(" -->"))
            else:
                mark = ""
                prose.append(line)
        paragraphs = "\n".join(prose).split("\n\n")
        self.codes = [" ".join(code.split()) for paragraph in paragraphs for code in paragraph.split("`")[1::2]]

    def mark(self, words):
        kind, _, rest = words.partition(": ")
        self.is_slow |= words == "slow"
        if kind == "minutes" and rest:
            self.long.append(rest)
            return ""
        return kind

    def runner(self, mark):
        """Runner of a block with this mark."""
        typed = "long test" if self.is_slow else "test"
        return {"ci": "ci", "minutes": "tool", "no": "not run"}.get(mark, typed)


def commands(lines):
    """Commands of a block, one a line; a here document and a line that ends in a backslash go on."""
    found = []
    for line in lines:
        if found and goes_on(found[-1]):
            found[-1] += "\n" + line
        elif line and not line.startswith("#"):
            found.append(line)
    return found


def goes_on(command):
    end = command.partition("<<")[2].split()
    return command.endswith("\\") or bool(end) and end[0].strip("'") not in command.split("\n")[1:]


def in_one_line(command):
    return " ".join(command.replace("\\\n", " ").split("\n")[0].split(" #")[0].split())


def inline_runner(code, long):
    """Runner of inline code; None when it is no command."""
    words = code.split(" ")
    if words[0] not in ("upm", "upm-lab", "cargo", "python3") or len(words) < 2:
        return None
    if any(map(PLACEHOLDER.search, words)):
        return "inline, named"
    argument = {"upm": words[2:3], "upm-lab": words[1:2]}.get(words[0])
    if argument and not argument[0].startswith("-"):
        return "inline, tool" if code in long else "inline, long test"
    builds = words[0] == "cargo" and words[1] in ("bench", "build", "run", "test") and len(words) > 2
    # this tool does not run itself
    measures = words[0] == "python3" and words[1].startswith("tools/") and words[1] != "tools/doc_commands.py"
    return "inline, tool --heavy" if builds or measures else "inline, named"


def all_pages():
    names = [path.relative_to(ROOT).as_posix() for folder in (ROOT, ROOT / "docs") for path in folder.glob("*.md")]
    return [Page(name, (ROOT / name).read_text()) for name in sorted(names) if name != "CHANGELOG.md"]


def listed(pages):
    """Page, runner, command in one line, command as a shell takes it."""
    long = {command for page in pages for command in page.long}
    for page in pages:
        for mark, block in page.blocks:
            yield from ((page.name, page.runner(mark), in_one_line(command), command) for command in block)
        for code in page.codes:
            if runner := inline_runner(code, long):
                yield page.name, runner, code, code


class Workspace:
    """A folder that `upm init .` made, with `upm` and `upm-lab` (`cargo build -p upm-lab`) on the PATH."""

    def __init__(self, upm, folder):
        self.upm, self.typed = os.path.abspath(upm), pathlib.Path(folder) / "typed"
        binaries = pathlib.Path(folder) / "bin"
        for made in (self.typed, binaries):
            made.mkdir()
        (binaries / "upm").symlink_to(self.upm)
        (binaries / "upm-lab").symlink_to(pathlib.Path(self.upm).with_name("upm-lab"))
        self.env = os.environ | {"PATH": f"{binaries}:{os.environ['PATH']}"}
        subprocess.run([self.upm, "init", ".", "--quiet"], cwd=self.typed, check=True, stdout=subprocess.DEVNULL)

    def run(self, command, limit_s):
        """Seconds, exit status (or `limit`) and output of a command."""
        words = command.split()
        if words[0] == "python3" and "--upm" in (ROOT / words[1]).read_text():
            command += f" --upm '{self.upm}'"
        folder = self.typed if words[0] in ("upm", "upm-lab") else ROOT
        begun = time.monotonic()
        with tempfile.TemporaryFile("w+") as printed:
            shell = subprocess.Popen(["bash", "-c", command], cwd=folder, env=self.env, stdin=subprocess.DEVNULL,
                                     stdout=printed, stderr=subprocess.STDOUT, start_new_session=True)
            try:
                status = shell.wait(limit_s)
            except subprocess.TimeoutExpired:
                status = "limit"
            finally:
                if shell.poll() is None:
                    os.killpg(shell.pid, signal.SIGTERM)
                    shell.wait()
            printed.seek(0)
            return time.monotonic() - begun, status, printed.read()


def run_all(rows, upm, limit_s):
    """Runs each command once; true when none fails."""
    width, failed, done = max(len(page) for page, *_ in rows), 0, set()
    print(f"{'page':{width}}  {'seconds':>8}  status  command", flush=True)
    with tempfile.TemporaryDirectory() as folder:
        workspace = Workspace(upm, folder)
        for page, _, line, command in rows:
            if line in done:
                continue
            done.add(line)
            seconds, status, printed = workspace.run(command, limit_s)
            print(f"{page:{width}}  {seconds:8.1f}  {status!s:>6}  {line}", flush=True)
            if status != 0:
                failed += 1
                print("\n".join(f"    {shown}" for shown in printed.splitlines()[-SHOWN_LINES:]), flush=True)
    print(f"{len(done)} commands, {failed} failed")
    return not failed


def main():
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--upm", default=str(ROOT / "target/debug/upm"))
    parser.add_argument("--page", nargs="+", metavar="PAGE", help="these pages alone, as docs/lab.md")
    parser.add_argument("--heavy", action="store_true")
    parser.add_argument("--limit", type=float, metavar="SECONDS")
    parser.add_argument("--list", action="store_true")
    args = parser.parse_args()

    rows = [row for row in listed(all_pages()) if not args.page or row[0] in args.page]
    if args.list:
        print("\n".join("\t".join(row[:3]) for row in rows))
        return
    runners = ["tool", "inline, tool"] + ["inline, tool --heavy"] * args.heavy
    rows = [row for row in rows if row[1] in runners]
    if not rows:
        sys.exit("no command of these pages is for this tool")
    sys.exit(0 if run_all(rows, args.upm, args.limit) else 1)


if __name__ == "__main__":
    main()
