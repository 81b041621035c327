# Simulated frames through v4l2loopback.
. /lib.sh
serial_on || exit 1
modprobe v4l2loopback video_nr=10 card_label=hil exclusive_caps=1 max_buffers=8
wait_for 5 test -e /dev/video10 || exit 1
loopback_feed /dev/video10 720 576 25 /work/frames.raw /out/feed.txt 2>/out/feed.err &
wait_for 10 grep -q ready /out/feed.txt || exit 1
seconds=$(cat /work/seconds)
record b /work/rigs/b-loopback.toml "$seconds"
sleep 0.5
echo -n g >/tmp/feed
recorded b $((seconds + 20))
echo -n q >/tmp/feed
exit 0
