#!/usr/bin/env bash
# Prints memory (MB) and threads of a process every half minute: memory.sh PID MINUTES
for ((i = 0; i < $2 * 2; i++)); do
  [ -d "/proc/$1" ] || exit
  awk -v t=$((i * 30)) '/^VmRSS/ { rss = $2 / 1024 } /^Threads/ { threads = $2 } END { printf "%d s: %.1f MB, %d threads\n", t, rss, threads }' "/proc/$1/status"
  sleep 30
done
