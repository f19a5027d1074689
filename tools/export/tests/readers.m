% Reads an exported .mat file, and prints its content as JSON in the same form as readers.py.
function values = plain(values)
  % Rows one after the other, and always an array.
  values = num2cell(double(values')(:))';
end

path = argv(){end};
file = load(path);
found = struct("rate_hz", file.rate_hz, "t_s", {plain(file.t_s)}, "channels", struct(), "feet", struct());
for name = {"left", "right"}
  side = name{1};
  if ! isfield(file, side)
    continue
  end
  foot = file.(side);
  found.channels.([side "_total_force_n"]) = plain(foot.total_force_n);
  found.channels.([side "_cop_x_mm"]) = plain(foot.cop_mm(:, 1));
  found.channels.([side "_cop_y_mm"]) = plain(foot.cop_mm(:, 2));
  for i = 1:numel(file.regions)
    region = [side "_" file.regions{i}];
    found.channels.([region "_measured_force_n"]) = plain(foot.measured_force_n(:, i));
    found.channels.([region "_area_mm2"]) = plain(foot.area_mm2(:, i));
  end
  read = struct("source", foot.source, "pressure_kpa", {plain(foot.pressure_kpa)}, "layout", struct(), "steps", struct());
  read.heel_strike_s = plain(foot.heel_strike_s);
  read.toe_off_s = plain(foot.toe_off_s);
  for field = {"x_mm", "y_mm", "area_mm2", "region"}
    read.layout.(field{1}) = plain(foot.layout.(field{1}));
  end
  for field = fieldnames(foot.steps)'
    read.steps.(field{1}) = plain(foot.steps.(field{1}));
  end
  found.feet.(side) = read;
end
puts(jsonencode(found));
