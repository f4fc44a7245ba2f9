# Read by the shell of each page before its commands: `upm` writes into this folder, a daemon has a port of its own and a
# patient watchdog, and `cargo run` is the program under test. Expects PORT.
unset BASH_ENV
exec 2>&1
set -E
trap 'status=$?; echo "line $LINENO: exit status $status: $BASH_COMMAND"; exit 100' ERR
trap 'if [ -n "${server-}" ]; then kill "$server" && wait "$server" || exit 101; fi' EXIT
export UPM_URL=http://127.0.0.1:$PORT
command upm init . --quiet
sed -i 's|"watchdog": .*|"watchdog": {"no_part_s": 60, "blocked_s": 60}|' configs/daemon.json

upm() {
  # beside a daemon people do not type faster, and a queued job begins meanwhile
  if [ -n "${server-}" ]; then sleep 0.5; fi
  if [ "$1" != serve ]; then command upm "$@"; return; fi
  command upm "$@" --listen "127.0.0.1:$PORT" &
  server=$!
  until command upm plates >/dev/null 2>&1; do kill -0 "$server"; sleep 0.1; done
}

cargo() {
  local program=upm
  while [ "$1" != -- ]; do
    if [ "$1" = upm-lab ]; then program=upm-lab; fi
    shift
  done
  shift
  command "$program" "$@"
}
