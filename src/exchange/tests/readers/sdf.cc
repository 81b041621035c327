// Reads the written SDF with libsdformat: prints what it makes of it.
#include <iostream>
#include <sdf/sdf.hh>

int main(int, char **given) {
  sdf::Root root;
  const auto errors = root.Load(given[1]);
  for (const auto &error : errors) std::cerr << error << "\n";
  const auto *model = root.Model();
  if (!errors.empty() || !model) return 1;
  double mass = 0.0;
  for (uint64_t k = 0; k < model->LinkCount(); ++k)
    mass += model->LinkByIndex(k)->Inertial().MassMatrix().Mass();
  int plugins = 0;
  for (auto e = model->Element()->GetElement("plugin"); e; e = e->GetNextElement("plugin")) ++plugins;
  std::cout.precision(17);
  std::cout << model->Name() << " " << model->LinkCount() << " " << model->JointCount() << " "
            << plugins << " " << mass << "\n";
}
