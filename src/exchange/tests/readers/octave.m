% Integrates the written function beside our simulation: prints the largest relative distance.
folder = argv(){1};
addpath(folder);
thrust = dlmread([folder '/thrust.csv']);
ours = dlmread([folder '/motion.csv']);
start = dlmread([folder '/start.csv'])';
h = 0.02;
state = start; rows = [];
for k = 1:size(thrust, 1)
    if mod(k - 1, 10) == 0, rows(end + 1, :) = state'; end
    t = (k - 1) * h; ui = thrust(k, :)';
    k1 = mss_model(state, ui, t);
    k2 = mss_model(state + 0.5*h*k1, ui, t + 0.5*h);
    k3 = mss_model(state + 0.5*h*k2, ui, t + 0.5*h);
    k4 = mss_model(state + h*k3, ui, t + h);
    state = state + h/6*(k1 + 2*k2 + 2*k3 + k4);
end
% MSS has rates first.
theirs = [rows(:, 7:12) rows(:, 1:6)];
n = min(size(ours, 1), size(theirs, 1));
scale = max(max(abs(ours)), 1e-6);
printf('%.3e\n', max(max(abs(ours(1:n, :) - theirs(1:n, :))) ./ scale));
