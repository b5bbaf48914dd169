#!/bin/bash
# SPDX-FileCopyrightText: 2026 The slicecorr authors
# SPDX-License-Identifier: Apache-2.0
#
# A Slurm cluster of virtual nodes on this machine, for tests. See --help.
set -euo pipefail

if [[ ${1:-} == --help || $# -lt 3 ]]; then
  cat <<'END'
Usage: tests/slurm_up.sh FOLDER CONTROLLER-PORT NODE-PORT... [--help]

Starts munged, slurmctld and a slurmd for each NODE-PORT (nodes n1, n2 ...) with all their files in FOLDER, as
any user; needs nothing in /etc. Prints "READY" when all nodes are idle. Then use it with SLURM_CONF=FOLDER/slurm.conf.
Ports are of the loopback; choose free ones.

Reads commands from stdin, a line each, and answers "OK" or "FAILED":
  stop-controller     kill -9 of slurmctld
  start-controller    with the state that it saved
  stop-node NODE      kill -9 of slurmd; its jobs' processes go on
  power-off NODE      kill -9 of slurmd and of everything that runs on the node
  start-node NODE
At the end of stdin, or on TERM, everything is stopped, with whatever jobs left behind. When this script is killed, a
guard does it that is no child of it. Once a controller was started again, an administrator is there as well, who
resumes nodes that were drained because of a job number given twice.

Environment: SLURM_UP_CPUS (2) and SLURM_UP_MEMORY_MB (6000) of a node; SLURM_UP_NAMES, what names of nodes begin with
(n); SLURM_UP_CGROUPS=1, limits memory through cgroups (version 1, as root; names of nodes must then differ from those
of other clusters on this machine); SLURM_UP_CONF, lines added to slurm.conf.
END
  [[ ${1:-} == --help ]] && exit 0
  exit 2
fi

# Waits so many seconds, without a program for it: on what nobody writes to.
open_pause() {
  [[ -p $1/never ]] || mkfifo "$1/never"
  exec {never}<>"$1/never"
}
pause() { read -rt "$1" -u "$never" || true; }

# kill -9 of all processes with such a line in their environment, but for ourselves and the test, until there are none.
kill_by_environment() {
  local conf=$1 pattern=$2 round file pid found
  for round in {1..20}; do
    found=no
    while read -r file; do
      pid=${file#/proc/}
      pid=${pid%/environ}
      [[ $pid == "$$" || $pid == "$BASHPID" || $pid == "$PPID" ]] && continue
      [[ $pattern == '.*' ]] || grep -zqxE -- "$pattern" "$file" 2>/dev/null || continue
      kill -9 "$pid" 2>/dev/null && found=yes
    done < <(grep -lzxF -- "SLURM_CONF=$conf" /proc/[0-9]*/environ 2>/dev/null)
    [[ $found == yes ]] || break
    pause 0.02
  done
}

remove_cgroups() {
  local name group
  for name in "$@"; do
    for group in /sys/fs/cgroup/*/"slurm_$name"; do
      [[ ! -d $group ]] || find "$group" -depth -type d -exec rmdir {} + 2>/dev/null || true
    done
  done
}

if [[ $1 == --guard ]]; then
  open_pause "$3"
  # Of a process that ended nothing is left, or a zombie that nobody has looked after yet.
  while read -r line 2>/dev/null <"/proc/$2/stat" && [[ $line != *") Z "* ]]; do pause 0.3; done
  kill_by_environment "$3/slurm.conf" '.*'
  remove_cgroups "${@:4}"
  exit 0
fi

folder=$(realpath -m "$1")
controller_port=$2
node_ports=("${@:3}")
nodes=()
for i in "${!node_ports[@]}"; do nodes+=("${SLURM_UP_NAMES:-n}$((i + 1))"); done
user=$(id -un)
umask 022
mkdir -p "$folder"/{munge,state,log}
open_pause "$folder"
export SLURM_CONF="$folder/slurm.conf"
rm -f "$folder/munge/key"
(umask 077; head -c 256 /dev/urandom >"$folder/munge/key")

{
  cat <<END
ClusterName=farmtest
SlurmctldHost=localhost(127.0.0.1)
SlurmctldPort=$controller_port
CommunicationParameters=NoInAddrAny,NoCtldInAddrAny
SlurmUser=$user
SlurmdUser=$user
AuthType=auth/munge
CredType=cred/munge
# With the default of 120 s a job that is started again waits for so long.
AuthInfo=socket=$folder/munge/sock,cred_expire=5
MpiDefault=none
SwitchType=switch/none
AccountingStorageType=accounting_storage/none
JobCompType=jobcomp/none
StateSaveLocation=$folder/state
SlurmdSpoolDir=$folder/spool.%n
SlurmctldPidFile=$folder/slurmctld.pid
SlurmdPidFile=$folder/slurmd.%n.pid
SlurmctldLogFile=$folder/log/slurmctld.log
SlurmdLogFile=$folder/log/slurmd.%n.log
SchedulerType=sched/backfill
SchedulerParameters=bf_interval=1,sched_interval=1,sched_min_interval=50000
SelectType=select/cons_tres
SelectTypeParameters=CR_Core_Memory
MaxArraySize=10001
ReturnToService=2
SlurmdTimeout=5
SlurmctldTimeout=5
MessageTimeout=3
KillWait=2
MailProg=/bin/true
END
  if [[ ${SLURM_UP_CGROUPS:-0} == 1 ]]; then
    printf '%s\n' ProctrackType=proctrack/cgroup TaskPlugin=task/cgroup
    printf '%s\n' CgroupPlugin=autodetect IgnoreSystemd=yes ConstrainRAMSpace=yes >"$folder/cgroup.conf"
  else
    printf '%s\n' ProctrackType=proctrack/linuxproc TaskPlugin=task/none
    # slurmd loads such a plugin even when nothing is to use it. By default it looks for one, and ends where no cgroup
    # file system is mounted; this one looks for nothing until it is used. (22.05 knows no "disabled".)
    echo CgroupPlugin=cgroup/v1 >"$folder/cgroup.conf"
  fi
  printf '%s\n' "${SLURM_UP_CONF:-JobAcctGatherType=jobacct_gather/none}"
  for i in "${!node_ports[@]}"; do
    echo "NodeName=${nodes[i]} NodeHostname=localhost NodeAddr=127.0.0.1 Port=${node_ports[i]}" \
      "CPUs=${SLURM_UP_CPUS:-2} RealMemory=${SLURM_UP_MEMORY_MB:-6000} State=UNKNOWN"
  done
  echo "PartitionName=farm Nodes=ALL Default=YES MaxTime=INFINITE State=UP"
} >"$SLURM_CONF"

declare -A pids=()

stop_daemon() {
  local pid=${pids[$1]:-}
  [[ -n $pid ]] || return 0
  kill "-$2" "$pid" 2>/dev/null || true
  wait "$pid" 2>/dev/null || true
  unset "pids[$1]"
}

start_controller() {
  slurmctld -D "$@" -f "$SLURM_CONF" >>"$folder/log/slurmctld.out" 2>&1 </dev/null &
  pids[controller]=$!
}

start_node() {
  mkdir -p "$folder/spool.$1"
  # What it starts has this, too: the node can be powered off with all that runs on it.
  SLURM_UP_NODE=$1 slurmd -D "${@:2}" -N "$1" -f "$SLURM_CONF" >>"$folder/log/slurmd.$1.out" 2>&1 </dev/null &
  pids[$1]=$!
}

all_daemons_live() {
  local pid
  for pid in "${pids[@]}"; do kill -0 "$pid" 2>/dev/null || return 1; done
}

# What nobody else does here: nodes that were drained for this wait for somebody to look at them.
administrate() {
  local node state reason
  while pause 2; do
    while read -r node state reason; do
      [[ $state == drain* && $reason == 'Duplicate jobid' ]] || continue
      timeout 5 scontrol update "nodename=$node" state=resume || true
    done < <(timeout 5 sinfo -h -N -o '%N %T %E')
  done
}

down() {
  trap '' TERM INT
  trap - EXIT
  local name
  # Nothing of this cluster is needed any more: no farewells, which take seconds.
  for name in "${!pids[@]}"; do kill -9 "${pids[$name]}" 2>/dev/null || true; done
  kill_by_environment "$SLURM_CONF" '.*'
  for name in "${!pids[@]}"; do wait "${pids[$name]}" 2>/dev/null || true; done
  [[ ${SLURM_UP_CGROUPS:-0} != 1 ]] || remove_cgroups "${nodes[@]}"
  [[ ! -s $folder/guard.pid ]] || kill "$(<"$folder/guard.pid")" 2>/dev/null || true
}
trap 'down; exit 1' EXIT
trap 'exit 1' TERM INT

# In a session of its own and nobody's child: it outlives whoever kills the test with all that it started.
(env -u SLURM_CONF setsid "$BASH" -c 'echo $$ >"$2/guard.pid"; exec "$BASH" "$0" --guard "$@"' \
  "$(realpath "$0")" $$ "$folder" "${nodes[@]}" </dev/null >/dev/null 2>&1 &)

# Forced: sockets in folders that are not everybody's are refused otherwise.
munged --force --foreground --key-file="$folder/munge/key" --socket="$folder/munge/sock" --pid-file="$folder/munge/pid" \
  --log-file="$folder/munge/log" --seed-file="$folder/munge/seed" >"$folder/log/munged.out" 2>&1 </dev/null &
pids[munged]=$!
end=$((SECONDS + 20))
until munge -S "$folder/munge/sock" -n >/dev/null 2>&1; do
  pause 0.02
  kill -0 "${pids[munged]}" 2>/dev/null && [[ $SECONDS -lt $end ]] || { cat "$folder/log/munged.out" >&2; exit 1; }
done
start_controller -c
for node in "${nodes[@]}"; do start_node "$node" -c; done
end=$((SECONDS + 30))
until [[ $(timeout 5 sinfo -h -N -o %T 2>/dev/null | grep -c '^idle$') == "${#node_ports[@]}" ]]; do
  pause 0.05
  # A daemon ends at once when its port is taken.
  if ! all_daemons_live || [[ $SECONDS -ge $end ]]; then
    tail -n 5 "$folder"/log/*.out "$folder"/log/*.log >&2 || true
    exit 1
  fi
done
echo READY

while read -r command node; do
  answer=OK
  case "$command" in
    stop-controller) stop_daemon controller 9 ;;
    start-controller)
      start_controller
      if [[ -z ${pids[administrator]:-} ]]; then
        administrate </dev/null >/dev/null 2>&1 &
        pids[administrator]=$!
      fi
      ;;
    stop-node) stop_daemon "$node" 9 ;;
    power-off)
      stop_daemon "$node" 9
      kill_by_environment "$SLURM_CONF" "SLURM_UP_NODE=$node|SLURMD_NODENAME=$node"
      ;;
    start-node) start_node "$node" ;;
    *) answer=FAILED ;;
  esac
  echo "$answer"
done
trap - EXIT
down
