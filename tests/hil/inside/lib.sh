# Sourced by every guest script as /lib.sh.
export LD_LIBRARY_PATH=/lib/x86_64-linux-gnu RUST_BACKTRACE=1

up() { cut -d' ' -f1 /proc/uptime; }

# say TEXT: progress on the console
say() { echo "== $(up) $*"; }

# wait_for SECONDS COMMAND...: until the command succeeds; 1 when it never does
wait_for() {
  n=$(($1 * 20)); shift
  while [ $n -gt 0 ]; do "$@" >/dev/null 2>&1 && return 0; sleep 0.05; n=$((n - 1)); done
  echo "TIMEOUT waiting for: $*"; return 1
}

# mark JSON: asks the host for something (see host/vm.py), waits for its answer, prints it
mark() {
  id=$(up | tr -d .)-$$-$RANDOM
  echo "MARK $id $*"
  wait_for 15 test -e "/out/ack.$id" || return 1
  cat "/out/ack.$id"; rm -f "/out/ack.$id"
}

# vivid_on [MODULE OPTION...]: one TV input (PAL 720x576) on /dev/video0, stamps at start of exposure
vivid_on() {
  modprobe vivid n_devs=1 node_types=0x1 num_inputs=1 input_types=0x1 "$@"
  wait_for 5 test -e /dev/video0 || return 1
  # With the default end-of-frame source vivid stamps 0.9 frame into the future.
  v4l2-ctl -d /dev/video0 -c timestamp_source=1
}

# vivid_control NAME=VALUE
vivid_control() { v4l2-ctl -d /dev/video0 -c "$1"; }

# uvc_on FPS LOG: a UVC camera with the stripe frames; nodrop=1 hands out frames with the error flag, as kernels after 6.1 do
uvc_on() {
  modprobe vhci-hcd
  [ -d /sys/module/uvcvideo ] || modprobe uvcvideo nodrop=1
  uvc_camera "$1" "$2" /work/0.jpg /work/1.jpg /work/2.jpg 2>>/out/uvc_camera.err &
  UVC_PID=$!
  wait_for 10 test -e /dev/video0
}

# uvc_fault LETTER: see inject/uvc_camera.c
uvc_fault() { echo -n "$1" >/tmp/uvc; }

# serial_on: the FTDI adapter as /dev/ttyUSB0, the controller behind it started
serial_on() {
  modprobe xhci-pci; modprobe ftdi_sio
  # qemu's usb-serial is only plugged in while something is connected to its socket.
  mark '{"controller":"start"}' || return 1
  wait_for 10 test -e /dev/ttyUSB0
}

# record NAME RIG SECONDS [OPTION...]: the daemon into /tmp/NAME.mcap, in the background; its exit code later in /out/NAME.rc.
# tmpfs, not 9p: the guest's share writes slower than a disk, and a stalled disk is another test.
record() {
  name=$1 rig=$2 seconds=$3; shift 3
  rm -f "/tmp/$name".*
  ( hydroline record --rig "$rig" --for "${seconds}s" --out "/tmp/$name.mcap" "$@" \
      >"/out/$name.stdout" 2>"/out/$name.stderr"; echo $? >"/tmp/$name.rc" ) &
  RECORD_PID=$!
  # Recording has begun when the first frames are in the file. What stands before them (schemas, rig, clock) is 50 kB and
  # grows with them; ten JPEGs or one raw frame are more than the 200 kB left.
  wait_for 20 sh -c "[ -e /tmp/$name.rc ] || [ \$(stat -c %s /tmp/$name.mcap 2>/dev/null || echo 0) -gt 250000 ]"
}

# recorded NAME SECONDS: waits for the end, at most SECONDS; brings the files out
recorded() {
  wait_for "$2" test -e "/tmp/$1.rc" || { killall -TERM hydroline; wait_for 5 test -e "/tmp/$1.rc" || echo 124 >"/tmp/$1.rc"; }
  for f in /tmp/"$1"*.mcap; do dd if="$f" of="/out/${f##*/}" bs=256k 2>/dev/null; done      # cp writes 4 KiB at a time, 9p hates that
  cp "/tmp/$1.rc" "/out/$1.rc"
  say "$1: exit $(cat "/tmp/$1.rc"), $(ls /tmp/$1*.mcap | wc -l) file(s), $(du -h "/tmp/$1.mcap" | cut -f1)"
  rm -f /tmp/"$1"*.mcap
}

# at WORD: when something was done to the daemon, on its own clock (CLOCK_BOOTTIME = CLOCK_MONOTONIC here: never suspended)
at() { echo "$(up) $*" >>/out/times.txt; }
