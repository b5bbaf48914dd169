#!/usr/bin/python3
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
"""Presses Tab in bash, zsh and fish after commands of the programs in a folder: BIN.

The shells read what --completion prints, and are asked what they would offer. That must be the subcommands that --help
lists, all its long options and no other, the words of options that have some, the printers that are there now with the
user's own, and files. Shells that are not installed are left out, and a line says so. Prints what is wrong and ends with
1, else 0."""

import fcntl
import os
import pathlib
import pty
import re
import select
import shutil
import struct
import subprocess
import sys
import tempfile
import termios
import time

BIN = pathlib.Path(sys.argv[1]).resolve()
ROOT = pathlib.Path(__file__).resolve().parent.parent
PROGRAMS = ["slicecorr", "resinctl", "slicecorr-post", "slicefarm", "printbridge", "printer-sim"]
# Of the user's own: a plain one, one to be quoted, one that can't be read, one that a shell could take for a command.
NAMES = ["mine", "my printer", "broken", "it's $(touch made) `touch made`"]
FILES = ["a.stl", "my part.stl", "note.txt", "local.toml"]
FOLDERS = ["deep", "my folder"]
# With a value that may be left out; fish offers values of such options behind = alone.
ATTACHED = [("fish", "--even-dead-zone")]
wrong = []


def check(holds, what):
    if not holds:
        wrong.append(what)


def same(found, expected, what):
    """The same things in any order; says what is too much and what is missing."""
    more, fewer = sorted(set(found) - set(expected)), sorted(set(expected) - set(found))
    check(not more and not fewer, f"{what}: {more[:6]} should not be offered, {fewer[:6]} should")


def run(*command, **more):
    return subprocess.run(command, capture_output=True, text=True, timeout=60, **more)


def on_terminal(command, folder, until, keys, **environment):
    """Runs a program on a terminal of its own, types when until(what was shown) is a number, until it is None."""
    child, terminal = pty.fork()
    if child == 0:
        os.chdir(folder)
        os.execvpe(command[0], command, {**os.environ, **environment})
    fcntl.ioctl(terminal, termios.TIOCSWINSZ, struct.pack("HHHH", 100, 400, 0, 0))
    shown, typed, end = b"", 0, time.monotonic() + 60
    while time.monotonic() < end:
        if typed < len(keys) and until(shown) == typed:
            os.write(terminal, keys[typed].encode())
            typed += 1
        if select.select([terminal], [], [], 0.02)[0]:
            try:
                shown += os.read(terminal, 65536)
            except OSError:
                break
    os.close(terminal)
    os.waitpid(child, 0)
    return shown.decode(errors="replace").replace("\r", "")


class Help:
    """What --help of a command says of its subcommands and options."""

    def __init__(self, program, path):
        self.program, self.path = program, path
        result = run(BIN / program, *path, "--help")
        check(result.returncode == 0, f"{self.line()}--help ends with {result.returncode}")
        self.commands, self.options, self.places = [], set(), []
        self.words, self.attached, self.numbers, self.texts = {}, set(), [], {}
        section, name = "", None
        for line in result.stdout.splitlines():
            if re.match(r"\S.*:$", line):
                section = line[:-1]
            entry = re.match(r"  (\S+)((?: \S+)*)(?:  +(.*))?$", line)
            words = re.search(r":\{([^}]*)\}", line)
            words = words and words[1].split(",")
            if section == "Subcommands" and entry:
                name = entry[1]
                self.commands.append(name)
                self.texts[name] = entry[3] or ""
            elif section == "Positionals" and entry:
                self.places.append(words)
            elif section and entry and entry[1].startswith("-"):
                # A word that may be left out stands in brackets behind =.
                optional = re.search(r"\[=([^\]]*)\]", entry[1])
                if optional:
                    words = optional[1].split(",")
                names = re.sub(r":?\{[^}]*\}|\[=[^\]]*\]", "", entry[1]).split(",")
                name = names[-1]
                self.options |= {n for n in names if n.startswith("--")}
                self.texts[name] = entry[3] or ""
                if words:
                    self.words[name] = words
                    # A flag that takes a word has it behind =.
                    if optional or "{" in entry[1] or entry[2].startswith(" :{"):
                        self.attached.add(name)
                elif re.match(r" (INT|FLOAT)\b", entry[2]):
                    self.numbers.append(name)
            elif name and line.startswith(" " * 30):
                self.texts[name] = (self.texts[name] + " " + line.strip()).strip()
        # The footer of the program says that its commands take them, too.
        self.common = {"--threads", "--quiet"} if "takes --threads and --quiet" in result.stdout else set()

    def line(self, *words):
        return " ".join([self.program, *self.path, *words, ""])


def helps_of(program, path=(), common=()):
    one = Help(program, path)
    one.options |= set(common)
    return [one, *(h for name in one.commands for h in helps_of(program, (*path, name), common or one.common))]


class Bash:
    """Calls the function as readline does. What is left to readline is told by the words @files and @folders."""

    name = "bash"

    def __init__(self, folder):
        self.folder = folder

    def words(self, line):
        """As readline takes a line apart: = and : are words, too."""
        found = re.findall(r"(?:\\.|'[^']*'?|\"[^\"]*\"?|[^\s=:\\'\"])+|[=:]+", line)
        return found + [""] if re.search(r"(?<!\\) $", line) else found

    def ask(self, lines, words=None, with_line=True):
        script = [f"source ./{program}.bash" for program in PROGRAMS]
        script.append(
            r"""
compopt() { said+=" $*"; }
ask() {
  said= COMP_CWORD=$((${#COMP_WORDS[@]} - 1)) COMP_POINT=${#COMP_LINE}
  "_${COMP_WORDS[0]//-/_}"
  ((${#COMPREPLY[@]} == 0)) || printf '%s\n' "${COMPREPLY[@]}"
  [[ $said == *default* && ${#COMPREPLY[@]} == 0 ]] && echo @files
  [[ $said == *dirnames* ]] && echo @folders
  printf '\1\n'
}"""
        )

        def quoted(text):
            return "'" + text.replace("'", r"'\''") + "'"

        for line in lines:
            all_words = " ".join(quoted(w) for w in (words or self.words)(line))
            script.append(f"COMP_WORDS=({all_words}) COMP_LINE={quoted(line if with_line else '')}; ask")
        result = run("bash", "--norc", "--noprofile", "-u", input="\n".join(script), cwd=self.folder)
        check(not result.stderr, f"bash says: {result.stderr[:400]}")
        return [answer.split("\n")[:-1] for answer in result.stdout.split("\1\n")[:-1]]

    def type(self, lines):
        """What stands in the line when Tab was pressed after it, in a shell on a terminal."""
        (self.folder / "bashrc").write_text(
            "\n".join(f"source ./{p}.bash" for p in PROGRAMS)
            + """
PS1='ready> ' COMP_WORDBREAKS=$' \\t\\n"\\'><=;|&(:'
bind 'set bell-style none'; bind 'set enable-bracketed-paste off'; bind 'set page-completions off'
bind -x '"\\C-t": printf "\\nline<%s>\\n" "$READLINE_LINE"'
"""
        )
        keys = [line + "\t\x14\x15" for line in lines] + ["exit\n"]
        shown = on_terminal(
            ["bash", "--noprofile", "--rcfile", "bashrc", "-i"],
            self.folder,
            lambda text: text.count(b"\nline<") if b"ready> " in text else None,
            keys,
            TERM="dumb",
        )
        return re.findall(r"\nline<(.*)>\n", shown)


class Fish:
    name = "fish"

    def __init__(self, folder):
        self.folder = folder
        self.texts = {}

    def ask(self, lines):
        script = [f"source {program}.fish" for program in PROGRAMS]
        for line in lines:
            script.append("complete -C '%s'; printf '\\1\\n'" % line.replace("\\", "\\\\").replace("'", "\\'"))
        result = run("fish", "--no-config", "-c", "\n".join(script), cwd=self.folder)
        check(not result.stderr, f"fish says: {result.stderr[:400]}")
        answers = []
        for line, answer in zip(lines, result.stdout.split("\1\n")):
            pairs = [a.partition("\t")[::2] for a in answer.split("\n")[:-1]]
            self.texts[line] = dict(pairs)
            # With a value after = it says the whole word.
            before = "".join(line.rpartition(" ")[2].rpartition("=")[:2])
            words = [word.removeprefix(before).rstrip("/") for word, _ in pairs]
            # An option whose value may be left out is there a second time, with a =.
            answers.append([word for word in words if not (word.startswith("--") and word.endswith("="))])
        return answers


class Zsh:
    """An editor of lines on a terminal completes; what the completion adds is written down."""

    name = "zsh"
    START = r"""
unset HISTFILE; setopt no_auto_list no_auto_menu no_list_beep; PS1='ready> '
fpath=($PWD/zsh $fpath)
autoload -Uz compinit; compinit -u -D
compadd() {
  # Such calls only fill arrays.
  if [[ ${@[1,(i)(-|--)]} == *-[a-zA-Z]#[OAD]\ * ]]; then
    builtin compadd "$@"
    return
  fi
  local -a hits texts
  local -i at=${@[(i)-d]} i
  (( at < $# )) && texts=("${(@P)@[at + 1]}")
  builtin compadd -O hits -D texts "$@"
  for ((i = 1; i <= $#hits; i++)); do
    print -r -- $hits[i]$'\t'$texts[i] >>zsh.answers
  done
  builtin compadd "$@"
}
ask-all() {
  local -a lines=("${(@f)$(<zsh.lines)}")
  local line
  for line in $lines; do
    BUFFER=$line CURSOR=$#line
    print -r -- $'\2' >>zsh.answers
    zle complete-word
    print -r -- $'\1'$BUFFER >>zsh.answers
  done
  exit
}
zle -N ask-all; bindkey '^T' ask-all
"""

    def __init__(self, folder):
        self.folder, self.lines, self.texts = folder, [], {}
        (folder / "zsh").mkdir()
        for program in PROGRAMS:
            shutil.copy(folder / f"{program}.zsh", folder / "zsh" / f"_{program}")
        (folder / ".zshrc").write_text(self.START)

    def ask(self, lines):
        answers = self.folder / "zsh.answers"
        answers.write_text("")
        (self.folder / "zsh.lines").write_text("\n".join(lines) + "\n")
        shown = on_terminal(
            ["zsh", "-i"],
            self.folder,
            lambda text: 0 if b"ready> " in text else None,
            ["\x14"],
            ZDOTDIR=str(self.folder),
            TERM="vt100",
        )
        check(not re.search(r"^_\S+:\d+:|command not found", shown, re.M), f"zsh says: {shown[-400:]}")
        pieces = [a.partition("\1") for a in answers.read_text().split("\2\n")[1:]]
        self.lines = [line.rstrip("\n") for _, _, line in pieces]
        answers = []
        for line, (found, _, _) in zip(lines, pieces):
            pairs = [a.partition("\t")[::2] for a in found.split("\n")[:-1]]
            # "--name  -- text" is shown.
            self.texts[line] = {name: text.partition("-- ")[2] for name, text in pairs}
            answers.append([re.sub(r"\\(.)", r"\1", name) for name, _ in pairs])
        return answers


class Questions:
    """Lines to complete, each with what is to be said of the answer."""

    def __init__(self):
        self.lines, self.judges = [], []

    def ask(self, line, judge):
        self.lines.append(line)
        self.judges.append(judge)

    def judge(self, shell):
        answers = shell.ask(self.lines)
        check(len(answers) == len(self.lines), f"{shell.name}: {len(answers)} answers to {len(self.lines)} lines")
        for line, judge, answer in zip(self.lines, self.judges, answers):
            judge(answer, f"{shell.name}: {line}")


def exactly(expected):
    return lambda answer, line: same(answer, expected, line)


def nothing(answer, line):
    check(not answer, f"{line}: offers {answer[:6]}, expected nothing")


def only(allowed):
    def judge(answer, line):
        more = [a for a in answer if a not in allowed]
        check(not more, f"{line}: {more[:6]} should not be offered")

    return judge


def at_least(expected, but=()):
    """These, and no options."""

    def judge(answer, line):
        missing = [e for e in expected if e not in answer]
        check(not missing, f"{line}: {missing} should be offered, not only {answer[:6]}")
        more = [a for a in answer if a in but or a.startswith("-")]
        check(not more, f"{line}: {more} should not be offered")

    return judge


def ask_by_help(q, shell, helps):
    """All that --help says."""
    shared = set()
    for h in helps:
        if h.commands:
            q.ask(h.line(), exactly(h.commands))
        q.ask(h.line() + "--", exactly(h.options))
        for name, words in h.words.items():
            # Commands share options.
            if (h.program, name, *words) in shared:
                continue
            shared.add((h.program, name, *words))
            if name not in h.attached and (shell.name, name) not in ATTACHED:
                # Where the value may be left out, what comes next may be offered, too.
                q.ask(h.line(name), at_least(words))
            # Zsh and fish take = apart by themselves.
            if shell.name == "bash" or name in h.attached or (shell.name, name) in ATTACHED:
                q.ask(h.line() + name + "=", exactly(words))
        for name in [n for n in h.numbers if (h.program, n) not in shared][:1]:
            shared.add((h.program, name))
            q.ask(h.line(name), nothing)
        for place, words in enumerate(h.places):
            if words:
                q.ask(h.line(*["x"] * place), at_least(words))


def check_texts(shell, helps):
    """What stands beside options is what --help says of them, whatever characters that has."""
    checked = 0
    for h in helps:
        texts = {**shell.texts[h.line() + "--"], **(shell.texts[h.line()] if h.commands else {})}
        # Zsh shows options with the same text in one line, and then texts apart from options.
        if shell.name == "zsh" and not any(texts.values()):
            continue
        checked += 1
        for name, said in texts.items():
            begin, text = said.removesuffix("…"), h.texts.get(name, "")
            right = not text or begin and text.startswith(begin)
            check(right, f"{shell.name}: {h.line()}{name} says '{said}', expected '{text}'")
    check(checked > 0.9 * len(helps), f"{shell.name}: texts are shown for {checked} of {len(helps)} commands only")


def of_files(shell, *found, but=()):
    """Judges files that are offered; bash leaves them to readline."""
    return exactly(["@files"]) if shell.name == "bash" else at_least(found, but)


def of_folders(shell):
    return exactly(["@folders"]) if shell.name == "bash" else at_least(FOLDERS, but=FILES)


def check_known(program):
    """The names that a program knows, by kind."""
    known = {}
    for kind, folder in (("printer", "printers"), ("resin", "db")):
        known[kind] = run(BIN / program, "--completion-names", kind).stdout.splitlines()
        shipped = {path.stem for path in (ROOT / "resins" / folder).glob("*.toml")}
        check(len(shipped) > 5 and shipped <= set(known[kind]), f"{program}: knows no {shipped - set(known[kind])}")
    check(set(NAMES) <= set(known["printer"]), f"{program}: knows not all of {NAMES}")
    return known


def ask_for_definitions(q, shell, program, helps, known):
    """Printers and resins, and files beside them."""
    files = ["local.toml", *FOLDERS]
    for kind in ("printer", "resin"):
        option = "--" + kind
        takers = [h for h in helps if option in h.options]
        for h in takers[:1]:
            q.ask(h.line(option), at_least(known[kind] + files, but=["note.txt"]))
            q.ask(h.line() + option + "=", at_least(known[kind] + files, but=["note.txt"]))
        if kind == "printer":
            check(takers, f"{program} takes no printer")
            q.ask(takers[-1].line(option) + "min", exactly(["mine"]))
    if program == "slicecorr":
        q.ask("slicecorr run --printer=min", exactly(["mine"]))
        q.ask("slicecorr run --printer my\\ ", exactly(["my printer", "my folder"]))
        # Slips; fish thinks of names that have these letters among others.
        slip = only(known["printer"]) if shell.name == "fish" else nothing
        q.ask("slicecorr run --printer dula", slip)
        q.ask("slicecorr run --printer note", slip)


def ask_of_places(q, shell):
    """What comes where."""
    q.ask("slicecorr slice ", of_files(shell, *FILES, *FOLDERS))
    q.ask("slicecorr slice a.stl ", of_files(shell, *FILES, *FOLDERS))
    q.ask("slicecorr slice a.stl -o ", of_files(shell, *FILES, *FOLDERS))
    q.ask("slicecorr slice --antialias on ", of_files(shell, *FILES, *FOLDERS))
    q.ask("slicecorr solid a.uvj --design a.stl ", of_files(shell, *FILES, *FOLDERS))
    q.ask("slicecorr solid a.uvj --design a.stl --red", exactly(["--reduce"]))
    q.ask("slicecorr slice -- --", of_files(shell))
    q.ask("slicecorr hologram --stack ", of_folders(shell))
    # Zsh leaves out what is there already.
    begin = "" if shell.name == "zsh" else "lamp,"
    q.ask("slicecorr plan a.stl --free lamp,", exactly([begin + w for w in ("omega-max", "edge-aim", "uv")]))
    q.ask("slicecorr --threads 2 sli", exactly(["slice"]))
    q.ask("slicecorr --quiet tomo --threads 2 sol", exactly(["solve"]))
    q.ask("slicecorr tomo solve --win", exactly(["--window"]))
    q.ask("slicecorr tune --printer-", exactly(["--printer-out", "--printer-output"]))
    q.ask("slicecorr tune --printer min", exactly(["mine"]))
    q.ask("slicecorr slice --uncertain-", nothing)
    q.ask("slicecorr correct --uncertain ", nothing)
    q.ask("slicecorr wrong ", nothing if shell.name != "bash" else exactly(Help("slicecorr", ()).commands))
    q.ask("resinctl add benchy-resin ", of_files(shell, *FILES))
    q.ask("resinctl plot ", at_least(["benchy-resin", *FILES], but=["mine"]))
    q.ask("resinctl show ", at_least(["benchy-resin", "mine", "local.toml"], but=["note.txt"]))
    q.ask("resinctl chemistry --light 100:1.6 0:5 ", at_least(["benchy-resin", "local.toml"]))
    q.ask("resinctl list --maker ", nothing)
    q.ask("resinctl diff mine ", nothing)
    q.ask("resinctl diff mine 1 ", nothing)
    q.ask("slicefarm submit --format ct", exactly(["ctb"]))
    q.ask("slicefarm status --state done,runn", exactly(["running" if shell.name == "zsh" else "done,running"]))
    q.ask("slicefarm status --dir ", of_folders(shell))


def ask_bash_otherwise(shell):
    """Where = ends no word, and where the line itself is not known."""
    def by_blanks(line):
        return line.split(" ")

    lines = ["slicecorr slice --printer=min", "slicecorr slice --units=in", "slicecorr tomo so"]
    expected = [["--printer=mine"], ["--units=inch"], ["solve"]]
    found = shell.ask(lines, words=by_blanks)
    check(found == expected, f"bash, words at blanks: {found}, expected {expected}")
    expected = [["mine"], ["inch"], ["solve"]]
    found = shell.ask(lines, with_line=False)
    check(found == expected, f"bash without COMP_LINE: {found}, expected {expected}")


TYPED = {
    "slicecorr sli": "slicecorr slice ",
    "slicecorr slice --printer=min": "slicecorr slice --printer=mine ",
    "slicecorr slice --printer my\\ p": "slicecorr slice --printer my\\ printer ",
    "slicecorr slice --printer=my\\ p": "slicecorr slice --printer=my\\ printer ",
    "slicecorr slice --printer loc": "slicecorr slice --printer local.toml ",
    "slicecorr slice --printer dee": "slicecorr slice --printer deep/",
    "slicecorr slice my\\ pa": "slicecorr slice my\\ part.stl ",
    "slicecorr slice --output=my\\ pa": "slicecorr slice --output=my\\ part.stl ",
    "slicecorr slice --surface=me": "slicecorr slice --surface=mesh ",
    "slicecorr hologram --stack my": "slicecorr hologram --stack my\\ folder/",
    "slicecorr tomo so": "slicecorr tomo solve ",
}


def check_typed(shell):
    """What Tab puts into the line."""
    typed = dict(TYPED)
    if shell.name == "bash":
        typed['slicecorr slice --printer "my p'] = 'slicecorr slice --printer "my printer" '
        typed["slicecorr slice 'my p"] = "slicecorr slice 'my part.stl' "
        found = shell.type(list(typed))
    else:
        found = shell.lines[-len(typed) :]
    check(len(found) == len(typed), f"{shell.name}: {len(found)} of {len(typed)} lines came back")
    for (line, expected), got in zip(typed.items(), found):
        check(got == expected, f"{shell.name}: Tab after '{line}' makes '{got}', expected '{expected}'")


def check_scripts(folder):
    for shell, check_only in (("bash", ["bash", "-n"]), ("zsh", ["zsh", "-n"]), ("fish", ["fish", "--no-execute"])):
        for program in PROGRAMS:
            result = run(BIN / program, "--completion", shell)
            check(result.returncode == 0 and not result.stderr, f"{program} --completion {shell} ends with {result.returncode}")
            script = folder / f"{program}.{shell}"
            script.write_text(result.stdout)
            if shutil.which(shell):
                result = run(*check_only, script)
                check(not (result.returncode or result.stderr), f"{shell}: {program}: {result.stderr[:400]}")
    if shutil.which("shellcheck"):
        result = run("shellcheck", *(folder / f"{program}.bash" for program in PROGRAMS))
        check(result.returncode == 0, f"shellcheck: {result.stdout[:600]}")
    result = run(BIN / "slicecorr", "--completion", "sh")
    check(result.returncode == 2 and "bash" in result.stderr, f"--completion sh ends with {result.returncode}: {result.stderr}")


def check_names(folder):
    """Nothing is said of what is broken."""
    (folder / "no-folder").write_text("")
    for place in ("no-folder", "nowhere", ".", "no-folder/below"):
        for kind in ("printer", "definition", "nonsense"):
            result = run(BIN / "resinctl", "--completion-names", kind, env={**os.environ, "SLICECORR_DB": place}, cwd=folder)
            check(result.returncode == 0 and not result.stderr, f"names of kind {kind} in {place}: {result.returncode}, {result.stderr}")
            lines = result.stdout.splitlines()
            check(lines == sorted(lines) and bool(lines) == (kind != "nonsense"), f"names of kind {kind} in {place}: {lines[:3]}")


def set_up(folder):
    printers = folder / "db" / "printers"
    printers.mkdir(parents=True)
    one = (ROOT / "resins/printers/dual-wavelength-dlp.toml").read_text()
    for name in NAMES:
        (printers / f"{name}.toml").write_text("display = [" if name == "broken" else one)
    (folder / "here").mkdir()
    for name in FILES:
        (folder / "here" / name).touch()
    for name in FOLDERS:
        (folder / "here" / name).mkdir()
    # Each program alone, as if the others were not installed.
    for program in PROGRAMS:
        (folder / "bin").mkdir(exist_ok=True)
        (folder / "bin" / program).symlink_to(BIN / program)
    for name in ("XDG_CONFIG_HOME", "BASH_ENV", "ENV"):
        os.environ.pop(name, None)
    os.environ.update(
        PATH=f"{folder / 'bin'}:/usr/bin:/bin",
        HOME=str(folder / "home"),
        SLICECORR_DB=str(folder / "db"),
        LC_ALL="C.UTF-8",
    )
    return folder / "here"


def main():
    with tempfile.TemporaryDirectory() as name:
        here = set_up(pathlib.Path(name))
        check_scripts(here)
        check_names(here)
        shells = []
        for kind in (Bash, Zsh, Fish):
            if shutil.which(kind.name):
                shells.append(kind(here))
            else:
                print(f"skipped: {kind.name} is not installed")
        helps = {program: helps_of(program) for program in PROGRAMS}
        known = {program: check_known(program) for program in PROGRAMS}
        for shell in shells:
            q = Questions()
            for program in PROGRAMS:
                ask_by_help(q, shell, helps[program])
                ask_for_definitions(q, shell, program, helps[program], known[program])
            ask_of_places(q, shell)
            if shell.name == "zsh":
                for line in TYPED:
                    q.ask(line, lambda answer, line: None)
            q.judge(shell)
            if shell.name != "bash":
                check_texts(shell, [h for program in PROGRAMS for h in helps[program]])
            if shell.name == "bash":
                ask_bash_otherwise(shell)
            if shell.name != "fish":
                check_typed(shell)
        check(not list(pathlib.Path(name).rglob("made")), "a shell ran what stands in a printer's name")
        commands = sum(len(h) for h in helps.values())
        options = sum(len(h.options) for all_helps in helps.values() for h in all_helps)
    print("\n".join(wrong) if wrong else f"{options} options of {commands} commands are completed by {', '.join(s.name for s in shells)}")
    sys.exit(bool(wrong))


main()
